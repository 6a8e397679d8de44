"""One of chapter 4's comparisons over seeds as a table."""

from job import job, snakemake

with job():
    from cospeech.evaluation.comparison import write_comparison
    from cospeech.evaluation.result import read_many

    evaluations = [one for path in snakemake.input for one in read_many(path)]
    write_comparison(snakemake.output.csv, evaluations, snakemake.params.rows)
