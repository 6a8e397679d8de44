"""One of chapter 4's comparisons over seeds as a table."""

from job import job, snakemake

with job():
    from cospeech.evaluation.comparison import read_comparison, write_comparison

    evaluations = [one for path in snakemake.input for one in read_comparison(path)]
    write_comparison(snakemake.output.csv, evaluations, snakemake.params.rows)
