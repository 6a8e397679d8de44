"""What MediaPipe sees in a take's film."""

from job import job, snakemake

with job():
    from cospeech.capture.mediapipe import MediapipeTracker
    from cospeech.capture.refusal import track_or_refusal
    from cospeech.capture.trackers import run_trackers
    from cospeech.capture.video import open_film

    files, params = snakemake.input, snakemake.params
    tracker = MediapipeTracker(params.folder)
    look = lambda: run_trackers(open_film(files.video, params.start, params.end), tracker)  # noqa: E731
    track_or_refusal(look, snakemake.wildcards.clip).write(snakemake.output.track)
