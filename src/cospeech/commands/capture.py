"""`cospeech track`, `annotate`, `overlay`, `face-model`: what is seen in a film, and the clip it becomes."""

import argparse
import os
import sys
from pathlib import Path

from cospeech.commands.results import configuration
from cospeech.errors import CospeechError, notice

TRACKERS = ("mediapipe", "posenet", "onnx", "tracks")


def add(commands):
    """Register the commands."""
    _add_track(commands)
    _add_annotate(commands)
    _add_overlay(commands)
    _add_face_model(commands)


def _add_track(commands):
    track = commands.add_parser(
        "track",
        help="see what a person does in a film",
        description=_track.__doc__,
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    option = track.add_argument
    option("video", metavar="VIDEO", help="any film that FFmpeg reads")
    option(
        "--tracker",
        default="mediapipe",
        metavar="NAME",
        help=f"{', '.join(TRACKERS)}; or one a part, as in 'body=mediapipe,left_hand=onnx,right_hand=onnx'",
    )
    option("--out", required=True, metavar="FILE.h5", help="track file to write")
    option("--start", type=float, default=0.0, metavar="SECONDS", help="where the take begins in the film")
    option("--end", type=float, metavar="SECONDS", help="where it ends (default: with the film)")
    option("--fps", type=float, help="frames per second (default: the film's own, halved until at most 30)")
    option("--manifest", metavar="FILE", help="onnx: the network's manifest, or rtmw3d, rtmw, deep3dfacerecon")
    option("--model", metavar="FILE.onnx", help="onnx: the network, where the manifest does not lie beside it")
    option("--tracks", metavar="PATH", help="tracks: file or folder of what another program saw in this film")
    option("--threads", type=int, help="onnx, posenet: CPU threads (default: all)")
    option("--environment", metavar="FOLDER", help="mediapipe: its environment (default: <results_dir>/envs/mediapipe)")
    option("--config", metavar="FILE", help="configuration that names results_dir")
    track.set_defaults(run=_track)


def _add_annotate(commands):
    annotate = commands.add_parser(
        "annotate",
        help="turn a track and its sound into a clip",
        description=_annotate.__doc__,
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    option = annotate.add_argument
    option("track", metavar="TRACK.h5", help="a track, as `cospeech track` writes it")
    option("--audio", metavar="FILE", help="its sound: any sound file, or the film itself (default: none, silence)")
    option(
        "--audio-start",
        type=float,
        metavar="SECONDS",
        help="where the track begins in FILE (default: where it began in the film, if FILE is that film; else 0)",
    )
    option("--out", required=True, metavar="CLIP.h5", help="clip file to write")
    option("--quality", metavar="FILE.h5", help="judgement of the take to write, and a page (.html) beside it")
    option("--subject", default="speaker", metavar="NAME", help="who it is, as the clip will say")
    option("--fps", type=float, default=15.0, help="frames per second of the clip")
    option("--bones", metavar="FILE.h5", help="one set of bone lengths of the speaker (default: this take's own)")
    option("--face-model", metavar="FILE", help="a 3D morphable model of your own (default: the embedded one)")
    annotate.set_defaults(run=_annotate)


def _add_overlay(commands):
    overlay = commands.add_parser("overlay", help="draw a track or a clip into its film", description=_overlay.__doc__)
    overlay.add_argument("file", help="a track or a clip (.h5)")
    overlay.add_argument("video", metavar="VIDEO", help="the film that it was made of")
    overlay.add_argument("--out", required=True, metavar="FILE.mp4", help="film to write, with the sound of VIDEO")
    overlay.add_argument("--start", type=float, default=0.0, metavar="SECONDS", help="a clip: where it begins in VIDEO")
    overlay.set_defaults(run=_overlay)


def _add_face_model(commands):
    model = commands.add_parser("face-model", help="convert a face model of your own", description=_face_model.__doc__)
    model.add_argument("file", help=".npz, .mat or .h5 with mean, bases and triangles (docs/face_model.md)")
    model.add_argument("--out", required=True, metavar="FILE.h5", help="face model file to write")
    model.add_argument("--licence", required=True, metavar="TEXT", help="its terms, told by every file made of it")
    model.add_argument("--units", help="m, dm, cm, mm or um (default: by the face's height)")
    model.add_argument("--landmarks", metavar="FILE", help="text file with the 68 vertices that are iBUG's landmarks")
    model.set_defaults(run=_face_model)


def _track(options):
    """See what a person does in a film, and write it as a track: body, hands and face with confidences."""
    from tqdm import tqdm

    from cospeech.capture.film.decoding import open_film
    from cospeech.capture.trackers.registry import run_trackers

    if Path(options.out).suffix.lower() != ".h5":
        raise CospeechError(f"{options.out}: a track is written as .h5; give a name that ends so")
    film = open_film(options.video, options.start, options.end, options.fps)
    trackers = _trackers(options)
    bar = lambda pictures: tqdm(pictures, "track", film.frames, unit="frame", disable=not sys.stderr.isatty())
    track = run_trackers(film, trackers, bar)
    track.write(options.out)
    shares = ", ".join(f"{part} {points.observed.mean():.0%}" for part, points in track.parts.items())
    print(f"{options.out}: {track.frames} frames at {track.fps:g} fps; observed: {shares or 'a face'}")


def _annotate(options):
    """Clean a track, fit the face, measure the speech, and write the take as a clip."""
    from cospeech.capture.annotate import annotate
    from cospeech.capture.cleanup.bone_lengths import read_bones
    from cospeech.face.model import FaceModel
    from cospeech.track import Track

    for path in filter(None, (options.out, options.quality)):
        if Path(path).suffix.lower() != ".h5":
            raise CospeechError(f"{path}: clips and qualities are written as .h5; give a name that ends so")
    track, out = Track.read(options.track), Path(options.out)
    start = options.audio_start
    if start is None:
        start = track.start if options.audio and Path(options.audio).name == Path(track.source).name else 0.0
    clip, quality = annotate(
        track,
        options.audio,
        subject=options.subject,
        clip=out.stem,
        fps=options.fps,
        audio_start=start,
        audio_path=os.path.relpath(options.audio, out.parent) if options.audio else "",
        bones=read_bones(options.bones) if options.bones else None,
        face_model=FaceModel.load(options.face_model) if options.face_model else None,
        name=options.track,
    )
    clip.write(out)
    if options.quality:
        from cospeech.render.pages.quality_page import write_page

        quality.write(options.quality)
        write_page(Path(options.quality).with_suffix(".html"), quality)
    seen = ", ".join(f"{part} {share:.0%}" for part, share in quality.observed.items())
    print(f"{out}: {clip.frames} frames at {clip.fps:g} fps; observed: {seen}; valid: {quality.valid:.0%}")


def _face_model(options):
    """Convert a 3D morphable face model from a usual layout into our own file, with a note of its licence."""
    from cospeech.face.layouts import read_landmarks
    from cospeech.face.model import convert

    landmarks = read_landmarks(options.landmarks) if options.landmarks else None
    model = convert(options.file, units=options.units, landmarks=landmarks, licence=options.licence)
    model.write(options.out)
    identity, expression, marked = model.identity.shape[2], model.expression.shape[2], model.landmarks.max() >= 0
    print(
        f"{options.out}: {len(model.mean)} vertices, {identity} of identity, {expression} expressions, "
        f"{'with' if marked else 'without'} landmarks"
    )


def _overlay(options):
    """Draw a track, or a clip beside it, into its film, with the film's sound."""
    from cospeech.capture.film.overlay import clip_pictures, sound_of, track_pictures
    from cospeech.clip import SCHEMA, Clip
    from cospeech.render.video import write_film
    from cospeech.track import Track

    if _schema(options.file) == SCHEMA:
        shown = Clip.read(options.file)
        start, pictures = options.start, clip_pictures(shown, options.video, options.start)
    else:
        shown = Track.read(options.file)
        start, pictures = shown.start, track_pictures(shown, options.video)
    sound = sound_of(options.video, start, shown.frames / shown.fps)
    write_film(options.out, pictures, shown.frames, shown.fps, sound)
    print(f"{options.out}: {shown.frames} frames")


def _schema(path):
    import h5py

    if not Path(path).is_file():
        raise CospeechError(f"{path}: no such file")
    try:
        with h5py.File(path, "r") as file:
            return file.attrs.get("schema")
    except OSError as error:
        raise CospeechError(f"{path}: not a readable HDF5 file (truncated, or another format)") from error


def _trackers(options):
    """The Tracker, or {part: Tracker}, that the options ask for."""
    if "=" not in options.tracker:
        return _tracker(options.tracker, options)
    pairs = [pair.partition("=")[::2] for pair in options.tracker.split(",")]
    made = {name: _tracker(name, options) for name in dict.fromkeys(name for _, name in pairs)}
    chosen = {}
    for part, name in pairs:
        tracker = made[name]
        if isinstance(tracker, dict) and part not in tracker:
            raise CospeechError(f"--tracker: {name} does not see {part}; it sees {', '.join(tracker)}")
        chosen[part] = tracker[part] if isinstance(tracker, dict) else tracker
    return chosen


def _tracker(name, options):
    results = Path(configuration(options.config).get("results_dir", "results"))
    if name == "mediapipe":
        from cospeech.capture.trackers.mediapipe import MediapipeTracker

        folder = Path(options.environment or results / "envs" / "mediapipe")
        return MediapipeTracker(_environment(folder))
    if name == "posenet":
        from cospeech.capture.trackers.onnx_network import posenet_trackers

        return posenet_trackers(results / "posenet", options.threads)
    if name == "onnx":
        from cospeech.capture.trackers.manifest import read_manifest
        from cospeech.capture.trackers.onnx_network import OnnxTracker

        if not options.manifest:
            raise CospeechError("--tracker onnx needs --manifest: a .yaml file, or rtmw3d, rtmw, deep3dfacerecon")
        return OnnxTracker(read_manifest(options.manifest, options.model), options.threads)
    if name == "tracks":
        from cospeech.capture.trackers.precomputed import PrecomputedTracker

        if not options.tracks:
            raise CospeechError("--tracker tracks needs --tracks: the file or folder that another program wrote")
        return PrecomputedTracker(options.tracks)
    raise CospeechError(f"tracker {name!r} is not one of {', '.join(TRACKERS)}")


def _environment(folder):
    """The folder of MediaPipe's environment, which is made on first use."""
    import cospeech
    from cospeech.capture.trackers.mediapipe import COMPLETE, VERSION, build_environment

    if not (folder / COMPLETE).is_file():
        asked = Path(cospeech.__file__).parents[2] / "envs" / "mediapipe-requirements.txt"
        if not asked.is_file():
            raise CospeechError(f"{folder}: no environment with MediaPipe {VERSION} there; see docs/capture.md")
        notice(f"{folder}: making an environment for MediaPipe {VERSION} (once, about a minute, needs the network)")
        build_environment(folder, asked)
    return folder
