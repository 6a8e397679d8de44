"""One of HA2G's tables, or all metrics of Table 1's rows."""

from job import job, snakemake

with job():
    from cospeech.evaluation.ha2g_tables import COLUMNS, write_ha2g
    from cospeech.evaluation.tables import read_evaluations

    columns = COLUMNS.get(snakemake.wildcards.get("table"))
    write_ha2g(snakemake.output.csv, read_evaluations(snakemake.input), snakemake.params.rows, columns)
