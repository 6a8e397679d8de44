# What the rows of the tables of thesis chapter 4 are, and the input functions of their rules (chapter4.smk).

from cospeech.gestures.generator import COMPARISONS

SEEDED = list(dict.fromkeys(row for rows in COMPARISONS.values() for row in rows))


def seeded_networks(wildcards):
    """Input function: the networks of a table's rows, of every seed."""
    folder = f"<results>/{wildcards.subject}/chapter4"
    return [f"{folder}/{row}_{seed}/model.onnx" for row in COMPARISONS[wildcards.table] for seed in SEEDS]


def seeded_settings(wildcards):
    """The budget's section for a row; windows of another length come in batches of as many frames in all."""
    settings = settings_for(wildcards.model, BUDGET, "chapter4")
    if frames := find(wildcards.model).changes.get("frames"):
        settings["batch"] = max(2, round(settings.get("batch", 25) * 64 / frames))
    return settings


def face_model_of(wildcards):
    """Input function: the subject's own face model, if it has one."""
    tracker = SUBJECTS[wildcards.subject].tracker
    return {"face_model": tracker["face_model"]} if "face_model" in tracker else {}
