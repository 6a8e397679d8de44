"""The network that knows people by their looks, as a file of its own."""

from job import job, snakemake

with job():
    from cospeech.gestures.ha2g.networks.identity import export_identity

    export_identity(snakemake.input.weights, snakemake.output.identity)
