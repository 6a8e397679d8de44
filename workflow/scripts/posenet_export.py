"""A trained pose network as ONNX with its manifest."""

from job import job, snakemake

with job():
    from cospeech.posenet.onnx_export import export_posenet

    export_posenet(snakemake.input.weights, snakemake.output.network, snakemake.output.manifest)
