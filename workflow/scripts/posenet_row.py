"""Train, export and score one row of Table 3.6 with one seed."""

from pathlib import Path

from job import job, snakemake

with job():
    from cospeech.learning.settings import settings_of
    from cospeech.posenet.evaluation.accuracy import evaluate
    from cospeech.posenet.onnx_export import export_posenet
    from cospeech.posenet.training.stages import Settings, train_posenet

    files, made = snakemake.input, snakemake.output
    train_posenet(
        files.people,
        settings_of(Settings(), snakemake.params.settings, "posenet").row(snakemake.wildcards.row),
        seed=int(snakemake.wildcards.seed),
        folder=Path(made.weights).parent,
        imagenet=files.get("imagenet") or None,
        test=files.test,
        checkpoint=snakemake.params.checkpoint,
    )
    export_posenet(made.weights, made.network, made.manifest)
    evaluation = evaluate(made.network, files.test, snakemake.threads)
    print(*evaluation.lines(), sep="\n")
    evaluation.write(made.evaluation)
