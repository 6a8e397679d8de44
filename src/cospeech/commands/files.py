"""`cospeech export`, `render` and `info`: what can be done with a file that is there."""

from pathlib import Path


def add(commands):
    """Register the commands."""
    export = commands.add_parser("export", help="turn a clip into BVH, GLB or CSV", description=_export.__doc__)
    export.add_argument("clip", help="a clip file (.h5), real or generated")
    export.add_argument("out", help="file to write; its suffix chooses the format: .bvh .glb .csv .h5")
    export.set_defaults(run=_export)
    render = commands.add_parser("render", help="draw a clip as a film with sound", description=_render.__doc__)
    render.add_argument("clips", nargs="+", metavar="clip", help="clip files (.h5), drawn side by side")
    render.add_argument("out", help="film to write (.mp4)")
    render.add_argument("--audio", help="sound of the film (default: the first clip's own)")
    render.set_defaults(run=_render)
    info = commands.add_parser("info", help="say what a file of this project holds", description=_info.__doc__)
    info.add_argument("file", help="any .h5 or .safetensors file of this project")
    info.set_defaults(run=_info)


def _export(options):
    """Turn a clip file into an animation (.bvh, .glb), a table (.csv) or a copy (.h5)."""
    from cospeech.clip import Clip
    from cospeech.formats.export import export_clip

    export_clip(Clip.read(options.clip), options.out)


def _render(options):
    """Draw one or several clips side by side as an mp4 with sound."""
    from cospeech.clip import Clip
    from cospeech.render.video import render_video

    clips = [Clip.read(path) for path in options.clips]
    sound = options.audio
    if not sound and clips[0].audio:
        own = Path(options.clips[0]).parent / clips[0].audio
        sound = str(own) if own.is_file() else None
    panels = [(f"{clip.subject} · {clip.generator or 'recorded'}", clip) for clip in clips]
    render_video(options.out, panels, audio=sound)


def _info(options):
    """Print what a file holds: its schema, attributes, arrays and, for weights, what they were trained as."""
    from cospeech.describe import describe

    print(describe(options.file))
