"""What MediaPipe sees in a take's film."""

from job import job, snakemake

with job():
    from cospeech.capture.mediapipe import MediapipeTracker
    from cospeech.capture.trackers import run_trackers
    from cospeech.capture.video import open_film

    film = open_film(snakemake.input.video, snakemake.params.start, snakemake.params.end)
    run_trackers(film, MediapipeTracker(snakemake.params.folder)).write(snakemake.output.track)
