"""What our own pose networks see in a take's film."""

from pathlib import Path

from job import job, snakemake

with job():
    from cospeech.capture.onnx_tracker import posenet_trackers
    from cospeech.capture.trackers import run_trackers
    from cospeech.capture.video import open_film

    film = open_film(snakemake.input.video, snakemake.params.start, snakemake.params.end)
    trackers = posenet_trackers(Path(snakemake.input.manifests[0]).parents[1], snakemake.threads)
    run_trackers(film, trackers).write(snakemake.output.track)
