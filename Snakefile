configfile: "config/config.yaml"


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
include: "workflow/rules/report.smk"


rule all:
    default_target: True
    input:
        all_models(),
        all_syntheses(),
        rules.evaluation.input,
        rules.control_tables.input,
        rules.posenet.input,
        rules.report.input,
