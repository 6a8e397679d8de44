"""`cospeech player`: clips side by side in one HTML page that needs no network."""

from pathlib import Path


def add(commands):
    """Register the command."""
    player = commands.add_parser("player", help="show clips side by side in a web page", description=_player.__doc__)
    player.add_argument("clips", nargs="+", metavar="CLIP", help="clip files (.h5), real or generated")
    player.add_argument("--out", required=True, metavar="PAGE", help="page to write (.html)")
    player.add_argument("--audio", metavar="FILE", help="sound of the page (default: the first clip's own)")
    player.add_argument("--titles", nargs="+", metavar="TITLE", help="one for each clip (default: who made it)")
    player.add_argument(
        "--posture",
        choices=["standing", "sitting", "none"],
        default="standing",
        help="of the legs, which clips do not have (default: standing)",
    )
    player.add_argument("--face-model", metavar="FILE", help="the face model whose coefficients the clips have")
    player.add_argument("--no-subtitles", action="store_true", help="leave the words out")
    player.set_defaults(run=_player)


def _player(options):
    """Write one HTML page that plays clips side by side with their sound, to be turned, zoomed and scrubbed."""
    from cospeech.clip import Clip
    from cospeech.errors import CospeechError
    from cospeech.render.pages.player_page import write_player

    clips = [Clip.read(path) for path in options.clips]
    if options.titles and len(options.titles) != len(clips):
        raise CospeechError(f"--titles: {len(options.titles)} for {len(clips)} clips; give one for each")
    titles = options.titles or [f"{clip.subject} · {clip.generator or 'recorded'}" for clip in clips]
    sound = options.audio
    if not sound:
        own = [Path(path).parent / clip.audio for path, clip in zip(options.clips, clips, strict=True) if clip.audio]
        sound = next((str(path) for path in own if path.is_file()), None)
    write_player(
        options.out,
        list(zip(titles, clips, strict=True)),
        audio=sound,
        posture=options.posture,
        subtitles=not options.no_subtitles,
        face=options.face_model,
    )
