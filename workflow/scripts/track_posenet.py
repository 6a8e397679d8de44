"""What our own pose networks see in a take's film."""

from pathlib import Path

from job import job, snakemake

with job():
    from cospeech.capture.onnx_tracker import posenet_trackers
    from cospeech.capture.refusal import track_or_refusal
    from cospeech.capture.trackers import run_trackers
    from cospeech.capture.video import open_film

    files, params = snakemake.input, snakemake.params
    trackers = posenet_trackers(Path(files.manifests[0]).parents[1], snakemake.threads)
    look = lambda: run_trackers(open_film(files.video, params.start, params.end), trackers)  # noqa: E731
    track_or_refusal(look, snakemake.wildcards.clip).write(snakemake.output.track)
