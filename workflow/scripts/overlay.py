"""A track drawn into its film."""

from job import job, snakemake

with job():
    from cospeech.capture.film.overlay import sound_of, track_pictures
    from cospeech.render.video import write_film
    from cospeech.track import Track

    video, track = snakemake.input.video, Track.read(snakemake.input.track)
    sound = sound_of(video, track.start, track.frames / track.fps)
    write_film(snakemake.output.film, track_pictures(track, video), track.frames, track.fps, sound)
