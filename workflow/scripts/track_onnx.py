"""What a network that a manifest describes sees in a take's film."""

from job import job, snakemake

with job():
    from cospeech.capture.manifest import read_manifest
    from cospeech.capture.onnx_tracker import OnnxTracker
    from cospeech.capture.refusal import track_or_refusal
    from cospeech.capture.trackers import run_trackers
    from cospeech.capture.video import open_film

    files, params = snakemake.input, snakemake.params
    tracker = OnnxTracker(read_manifest(files.manifest, params.model), snakemake.threads)
    look = lambda: run_trackers(open_film(files.video, params.start, params.end), tracker)  # noqa: E731
    track_or_refusal(look, snakemake.wildcards.clip).write(snakemake.output.track)
