"""Score a pose network on people that it has not seen."""

from job import job, snakemake

with job():
    from cospeech.posenet.evaluation.accuracy import evaluate

    evaluation = evaluate(snakemake.input.network, snakemake.input.people, snakemake.threads)
    print(*evaluation.lines(), sep="\n")
    evaluation.write(snakemake.output[0])
