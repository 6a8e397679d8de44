"""A clip as a film with sound, beside the recorded motion where there is one."""

from job import job, snakemake

with job():
    from cospeech.clip import Clip
    from cospeech.render.video import render_video

    clips = [Clip.read(path) for path in [snakemake.input.clip, *snakemake.input.truth]]
    panels = [(f"{clip.subject} · {clip.generator or 'recorded'}", clip) for clip in clips]
    render_video(snakemake.output.video, panels, audio=snakemake.input.audio)
