"""One of HA2G's tables, or all metrics of Table 1's rows."""

from job import job, snakemake

with job():
    from cospeech.evaluation.ha2g_result import columns_of, read_judgements, write_judged

    columns = columns_of(snakemake.wildcards.get("table"))
    write_judged(snakemake.output.csv, read_judgements(snakemake.input), snakemake.params.rows, columns, "method")
