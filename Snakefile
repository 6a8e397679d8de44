include: "workflow/rules/common.smk"
include: "workflow/rules/sources.smk"
include: "workflow/rules/capture.smk"
include: "workflow/rules/annotate.smk"
include: "workflow/rules/split.smk"
include: "workflow/rules/database.smk"
include: "workflow/rules/train.smk"
include: "workflow/rules/synthesis.smk"
include: "workflow/rules/evaluation.smk"
include: "workflow/rules/control.smk"
include: "workflow/rules/posenet.smk"
include: "workflow/rules/sync.smk"
include: "workflow/rules/common_chapter4.smk"
include: "workflow/rules/chapter4.smk"
include: "workflow/rules/common_ha2g.smk"
include: "workflow/rules/ha2g.smk"
include: "workflow/rules/ha2g_tables.smk"
include: "workflow/rules/films.smk"
include: "workflow/rules/report.smk"
include: "workflow/rules/study.smk"


rule all:
    default_target: not config.get("ensemble")
    input:
        all_models(),
        all_syntheses(),
        rules.evaluation.input,
        rules.control_tables.input,
        rules.posenet.input,
        rules.annotation.input,
        rules.report.input,


# A configuration with an `ensemble:` asks for what its speakers learn together, and for nothing else.
rule all_speakers:
    default_target: bool(config.get("ensemble"))
    input:
        rules.ha2g.input,
        rules.ha2g_table_1.input,
