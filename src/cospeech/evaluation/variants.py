"""The variants of the search in thesis Table 5.4, judged by this project's metrics instead of by people."""

from cospeech.evaluation import columns
from cospeech.evaluation.baseline_rows import BASELINES
from cospeech.evaluation.evaluate import evaluate_model
from cospeech.evaluation.generated import generate_clips
from cospeech.gestures.generator import MODELS, named

# Row: options of `KNN.generate`. The first two are the thesis's; then its two other choices, turned.
VARIANTS = {
    "knn_pose_only": {"variant": "pose_only"},
    "knn_audio": {"variant": "audio"},
    "knn_mean_pose": {"initial": "mean"},
    "knn_fifth": {"k": 5},
}
SEARCHING = named(needs="database")
# Every row's name in tables, in the order of Table 5.4: what needs no model, other models, the search's variants.
LABELS = (
    {"ground_truth": "Ground truth", "mismatched": "Mismatched audio-gesture", "mean_pose": "Mean pose"}
    | {name: MODELS[name].label for name in named(learns="speaker") if name not in SEARCHING}
    | {
        "knn_pose_only": "k-NN, pose only",
        "knn_audio": "k-NN, audio pre-selected",
        "knn_published": MODELS["knn_published"].label,
        "knn": MODELS["knn"].label,
        "knn_mean_pose": "k-NN, from the mean pose",
        "knn_fifth": "k-NN, fifth best (k = 5)",
    }
    | {name: MODELS[name].label for name in SEARCHING}
)
METRICS = (
    columns.FGD,
    columns.FGD_TRAIN,
    columns.MOTION_VARIANCE,
    columns.BEAT_CONSISTENCY,
    columns.BEAT_EXCESS,
    columns.BEAT_RATE,
    columns.SYNCHRONY,
)


def evaluate_variants(knn, clips, reference, seed=0):
    """Generate and judge every one of `VARIANTS`: -> {row: Evaluation}.

    knn : a KNN generator. clips : {clip id: Clip}, the test part. reference : the `Reference` of the other rows.
    """
    found, most = {}, len(knn.matcher.database)  # a tiny database has no fifth best
    for row, options in VARIANTS.items():
        options = {**options, "k": min(options.get("k", 1), most)}
        made = generate_clips(knn, clips, row, seed, smoothing=0.0, **options)
        found[row] = evaluate_model(row, made, reference)
    return found


def ordered(evaluations):
    """Evaluations in the order of Table 5.4 within each subject: baselines, other models, k-NN's variants, resync."""
    known = list(LABELS)
    rank = lambda row: known.index(row) if row in known else len(BASELINES) - 0.5
    subjects = list(dict.fromkeys(e.subject for e in evaluations))
    return sorted(evaluations, key=lambda e: (subjects.index(e.subject), rank(e.row)))
