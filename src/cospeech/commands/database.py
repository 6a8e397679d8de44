"""`cospeech database`: what can be done with a matching database that is there."""


def add(commands):
    """Register the commands."""
    database = commands.add_parser("database", help="look at a matching database, or add takes to it")
    actions = database.add_subparsers(title="actions", required=True, metavar="ACTION")
    info = actions.add_parser("info", help="say what a database holds", description=_info.__doc__)
    info.add_argument("database", help="a database file, such as results/calm/database.h5")
    info.set_defaults(run=_info)
    extend = actions.add_parser("extend", help="add takes without building it again", description=_extend.__doc__)
    extend.add_argument("database", help="a database file, such as results/calm/database.h5")
    extend.add_argument("clips", nargs="+", metavar="clip", help="clip files (.h5) of further takes of the speaker")
    extend.add_argument("--out", metavar="FILE", help="database to write (default: the same file)")
    extend.set_defaults(run=_extend)


def _info(options):
    """Print a database's size, as thesis Table 5.1 does, its takes, and control signals with their percentiles."""
    from cospeech.matching import Database

    database = Database.load(options.database)
    clips = [f"{(database.take == i).sum()} {name}" for i, name in enumerate(database.takes)]
    seconds = len(database) * database.clip_frames / database.fps
    size = f"{len(database)} clips of {database.clip_frames} frames at {database.fps:g} fps, {seconds:.1f} s"
    print(f"{options.database}: {size}")
    print(f"windows may start at {database.eligible.sum()} frames; {len(database.words)} words")
    print(f"clips by take: {', '.join(clips)}")
    for name, one in database.signals.items():
        low, middle, high = (one.percentiles[p] for p in (15, 50, 85))
        print(
            f"{name}: {one.lower} < {low:.3f}, median {middle:.3f}, {one.upper} > {high:.3f} {one.unit} ({one.about})"
        )


def _extend(options):
    """Add the takes of clip files to a database. The result is what building it from all takes would give."""
    from cospeech.clip import Clip
    from cospeech.matching.database.motion_database import extend

    database = extend(options.database, [Clip.read(path) for path in options.clips], options.out)
    print(f"{options.out or options.database}: {len(database)} clips of {len(database.takes)} takes")
