"""What our own pose networks see in a take's film."""

from pathlib import Path

from job import job, snakemake

with job():
    from cospeech.capture.film.decoding import open_film
    from cospeech.capture.refusal import track_or_refusal
    from cospeech.capture.trackers.onnx_network import posenet_trackers
    from cospeech.capture.trackers.registry import run_trackers

    files, params = snakemake.input, snakemake.params
    trackers = posenet_trackers(Path(files.manifests[0]).parents[1], snakemake.threads)
    look = lambda: run_trackers(open_film(files.video, params.start, params.end), trackers)
    track_or_refusal(look, snakemake.wildcards.clip).write(snakemake.output.track)
