"""What another program saw in a take's film, as a track."""

from job import job, snakemake

with job():
    from cospeech.capture.precomputed import PrecomputedTracker
    from cospeech.capture.refusal import track_or_refusal
    from cospeech.capture.trackers import run_trackers
    from cospeech.capture.video import open_film

    files, params = snakemake.input, snakemake.params
    film = lambda: open_film(files.video, params.start, params.end)  # noqa: E731
    look = lambda: run_trackers(film(), PrecomputedTracker(files.tracks, params.body_model))  # noqa: E731
    track_or_refusal(look, snakemake.wildcards.clip).write(snakemake.output.track)
