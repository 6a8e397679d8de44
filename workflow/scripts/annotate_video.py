"""A take on film becomes a clip: its track cleaned, its face fitted, its speech measured, and all of it judged."""

from job import job, snakemake

with job():
    from cospeech.capture.annotate import annotate
    from cospeech.capture.cleanup.bone_lengths import read_bones
    from cospeech.capture.film.media import words_of_take
    from cospeech.capture.refusal import clip_or_refusal
    from cospeech.face.model import FaceModel
    from cospeech.render.pages.quality_page import write_page
    from cospeech.speech import load_audio
    from cospeech.track import Track

    files, name = snakemake.input, snakemake.wildcards.clip
    about = {"subject": snakemake.wildcards.subject, "clip": name, "fps": snakemake.params.fps}
    about |= {"audio_path": f"../media/{name}.wav", "bones": read_bones(files.bones)}
    face_model = FaceModel.load(files.face_model) if files.get("face_model") else None

    def made():
        track = Track.read(files.track)
        words = words_of_take(files.words, files.film, track) if files.get("words") else None
        return annotate(track, files.wav, face_model=face_model, words=words, name=files.track, **about)

    clip, quality = clip_or_refusal(made, lambda: load_audio(files.wav), **about)
    quality.write(snakemake.output.quality)
    write_page(snakemake.output.page, quality, film=f"{name}.mp4")
    clip.write(snakemake.output.clip)
