"""`cospeech export`, `render` and `info`: what can be done with a file that is there."""

from pathlib import Path

from cospeech.errors import CospeechError


def add(commands):
    """Register the commands."""
    export = commands.add_parser("export", help="turn a clip into BVH, GLB or CSV", description=_export.__doc__)
    export.add_argument("clip", help="a clip file (.h5), real or generated")
    export.add_argument("out", help="file to write; its suffix chooses the format: .bvh .glb .csv .h5")
    export.set_defaults(run=_export)
    render = commands.add_parser("render", help="draw a clip as a film with sound", description=_render.__doc__)
    render.add_argument("clips", nargs="+", metavar="clip", help="clip files (.h5), drawn side by side")
    render.add_argument("out", help="film to write (.mp4), or picture (.png) with --still")
    render.add_argument("--audio", help="sound of the film (default: the first clip's own)")
    render.add_argument(
        "--still",
        metavar="SECONDS",
        help="one picture: of a moment, as in 3.2, or of a stretch, as "
        "in 2.0-4.5, whose poses lie over each other like a long exposure",
    )
    render.add_argument("--poses", type=int, default=6, help="how many poses a long exposure shows (default: 6)")
    render.add_argument(
        "--posture",
        choices=["standing", "sitting", "none"],
        default="standing",
        help="of the legs, which clips do not have (default: standing)",
    )
    render.add_argument("--whole", action="store_true", help="show a standing character down to the floor")
    render.add_argument("--face-model", metavar="FILE", help="the face model whose coefficients the clips have")
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
    """Draw one or several clips side by side as an mp4 with sound, or as a still picture."""
    from cospeech.clip import Clip
    from cospeech.render.exposure import long_exposure
    from cospeech.render.video import render_video

    clips = [Clip.read(path) for path in options.clips]
    panels = [(f"{clip.subject} · {clip.generator or 'recorded'}", clip) for clip in clips]
    character = {"posture": options.posture, "whole": options.whole or None, "face": options.face_model}
    if options.still:
        long_exposure(options.out, panels, *_stretch(options.still), poses=options.poses, **character)
        return
    sound = options.audio
    if not sound and clips[0].audio:
        own = Path(options.clips[0]).parent / clips[0].audio
        sound = str(own) if own.is_file() else None
    render_video(options.out, panels, audio=sound, **character)


def _stretch(text):
    """[seconds] of "3.2", or [start, end] of "2.0-4.5"."""
    try:
        parts = [float(part) for part in text.split("-")]
    except ValueError:
        parts = []
    if len(parts) not in (1, 2):
        raise CospeechError(f"--still {text!r}: expected seconds, as in 3.2, or a stretch, as in 2.0-4.5")
    return parts


def _info(options):
    """Print what a file holds: its schema, attributes, arrays and, for weights, what they were trained as."""
    from cospeech.commands.describe import describe

    print(describe(options.file))
