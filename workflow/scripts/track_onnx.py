"""What an ONNX network sees in a take's film, as its manifest says."""

from job import job, snakemake

with job():
    from cospeech.capture.manifest import read_manifest
    from cospeech.capture.onnx_tracker import OnnxTracker
    from cospeech.capture.trackers import run_trackers
    from cospeech.capture.video import open_film

    film = open_film(snakemake.input.video, snakemake.params.start, snakemake.params.end)
    manifest = read_manifest(snakemake.input.manifest, snakemake.params.model)
    run_trackers(film, OnnxTracker(manifest, snakemake.threads)).write(snakemake.output.track)
