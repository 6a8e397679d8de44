"""What another program saw in a take's film, as a track."""

from job import job, snakemake

with job():
    from cospeech.capture.precomputed import PrecomputedTracker
    from cospeech.capture.trackers import run_trackers
    from cospeech.capture.video import open_film

    film = open_film(snakemake.input.video, snakemake.params.start, snakemake.params.end)
    tracker = PrecomputedTracker(snakemake.input.tracks, snakemake.params.body_model)
    run_trackers(film, tracker).write(snakemake.output.track)
