"""What another program saw in a take's film, as a track."""

from job import job, snakemake

with job():
    from cospeech.capture.film.decoding import open_film
    from cospeech.capture.refusal import track_or_refusal
    from cospeech.capture.trackers.precomputed import PrecomputedTracker
    from cospeech.capture.trackers.registry import run_trackers

    files, params = snakemake.input, snakemake.params
    film = lambda: open_film(files.video, params.start, params.end)
    look = lambda: run_trackers(film(), PrecomputedTracker(files.tracks, params.body_model))
    track_or_refusal(look, snakemake.wildcards.clip).write(snakemake.output.track)
