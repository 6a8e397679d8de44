"""What a network that a manifest describes sees in a take's film."""

from job import job, snakemake

with job():
    from cospeech.capture.film.decoding import open_film
    from cospeech.capture.refusal import track_or_refusal
    from cospeech.capture.trackers.manifest import read_manifest
    from cospeech.capture.trackers.onnx_network import OnnxTracker
    from cospeech.capture.trackers.registry import run_trackers

    files, params = snakemake.input, snakemake.params
    tracker = OnnxTracker(read_manifest(files.manifest, params.model), snakemake.threads)
    look = lambda: run_trackers(open_film(files.video, params.start, params.end), tracker)
    track_or_refusal(look, snakemake.wildcards.clip).write(snakemake.output.track)
