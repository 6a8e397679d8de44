"""The ablation of Table 3.6 from the scores of its rows."""

from job import job, snakemake

with job():
    from cospeech.posenet.evaluation.ablation import TITLES, write_ablation

    write_ablation(snakemake.output[0], {row: snakemake.input[row] for row in TITLES})
