"""Every metric by its name: label, unit, which way is good, and what it says; tables and report follow from it.

A name is a constant here and nowhere put together from parts, so that it can be searched for.
"""

from dataclasses import dataclass

from cospeech.formats.result_table import headings

LOWER, HIGHER, TRUTH = "lower", "higher", "truth"  # is better; the last: near the recorded motion's


@dataclass(frozen=True)
class Metric:
    """What a column is called in a table for people, its unit ("" for none), which way is good, and what it says.

    heading : what it is called in a CSV file, where that is not its name.
    """

    label: str
    unit: str
    better: str
    about: str
    heading: str = ""


KNOWN = {}  # every metric: {name: Metric}


def _metric(name, *facts, **more):
    KNOWN[name] = Metric(*facts, **more)
    return name


def csv_headings(name):
    """The CSV headings of a metric and its deviation: `jerk [m/s^3]`, `jerk deviation [m/s^3]`."""
    return headings(KNOWN[name].heading or name, KNOWN[name].unit)


# ---- of one speaker: results/summary.csv, in this order -------------------------------------------------------------

FGD = _metric(
    "fgd",
    "FGD to test truth",
    "",
    LOWER,
    "Fréchet distance between features of 34-frame windows of this motion and of the test recordings; it judges "
    "whether the poses look like the speaker's, not whether they fit the speech.",
)
FGD_TRAIN = _metric(
    "fgd_train",
    "FGD to training part",
    "",
    LOWER,
    "The same against the training part: how far the test recordings themselves are from it shows how much of a "
    "distance is only chance.",
)
DIVERSITY = _metric(
    "diversity",
    "Diversity",
    "",
    TRUTH,
    "Mean distance between features of random pairs of windows; a mean pose has none, noise has too much.",
)
BEAT_CONSISTENCY = _metric(
    "beat_consistency",
    "Beat consistency",
    "",
    HIGHER,
    "How close each speech onset has a motion beat, 0 to 1; many beats alone already raise it, so read it together "
    "with the beat rate and the mismatched row.",
)
BEAT_EXCESS = _metric(
    "beat_excess",
    "Beat consistency over chance",
    "",
    HIGHER,
    "Beat consistency less what the same beats score against the speech at any other time: 0 is chance, and more beats "
    "do not raise it.",
)
BEAT_RATE = _metric("beat_rate", "Motion beats", "1/s", TRUTH, "Motion beats a second.")
SYNCHRONY = _metric(
    "synchrony",
    "Synchrony",
    "r",
    HIGHER,
    "Correlation of wrist speed with what the speech predicts; the mismatched row shows what is left when motion and "
    "speech have nothing to do with each other.",
)
MOTION_VARIANCE = _metric(
    "motion_variance",
    "Motion variance",
    "m^2",
    TRUTH,
    "Variance of the joints over time; regression to the mean makes it small.",
)
WRIST_SPEED_LEFT = _metric("wrist_speed_left", "Left wrist speed", "m/s", TRUTH, "Mean speed of the wrist.")
WRIST_SPEED_RIGHT = _metric("wrist_speed_right", "Right wrist speed", "m/s", TRUTH, "Mean speed of the wrist.")
WRIST_SPEED_SPREAD = _metric(
    "wrist_speed_spread", "Wrist speed spread", "m/s", TRUTH, "Standard deviation of the wrists' speeds over time."
)
WRIST_HEIGHT_LEFT = _metric(
    "wrist_height_left", "Left wrist height", "m", TRUTH, "Mean height of the wrist above the pelvis."
)
WRIST_HEIGHT_RIGHT = _metric(
    "wrist_height_right", "Right wrist height", "m", TRUTH, "Mean height of the wrist above the pelvis."
)
WRIST_HEIGHT_SPREAD = _metric(
    "wrist_height_spread", "Wrist height spread", "m", TRUTH, "Standard deviation of the wrists' heights over time."
)
WRIST_ASYMMETRY = _metric(
    "wrist_asymmetry", "Wrist height asymmetry", "m", TRUTH, "Mean difference of the wrists' heights."
)
SPEED_HELLINGER = _metric(
    "speed_hellinger",
    "Hellinger distance of speeds",
    "",
    LOWER,
    "Distance between the histograms of joint speeds, 0 (equal) to 1.",
)
ACCELERATION = _metric("acceleration", "Acceleration", "m/s^2", TRUTH, "Mean size of the joints' acceleration.")
JERK = _metric(
    "jerk",
    "Jerk",
    "m/s^3",
    TRUTH,
    "Mean size of the change of acceleration; jitter makes it large, over-smoothing small.",
)

METRICS = dict(KNOWN)  # of one speaker, in this order

# ---- of single tables -----------------------------------------------------------------------------------------------

LIP_ERROR = _metric(
    "lip_error",
    "Lip error",
    "mm",
    LOWER,
    "Mean distance of the lips' vertices from those of the recording, in the face model at neutral head pose.",
    heading="lip error",
)
JUDGED_IN_SYNC = _metric(
    "judged_in_sync",
    "Judged in sync",
    "%",
    TRUTH,
    "Share of windows that a classifier takes for in sync with their speech; not a measure of quality.",
    heading="judged in sync",
)

# ---- of motion as it is shown: results/tables/motion.csv ------------------------------------------------------------

BONE = _metric(
    "bone_mm", "Bones", "mm", LOWER, "Largest difference of any bone's length from the speaker's in the training part."
)
HAND_ROOT = _metric(
    "hand_root_mm",
    "Hands off wrists",
    "mm",
    LOWER,
    "Largest distance of a hand's root from its wrist beyond the usual.",
)
HIP = _metric(
    "hip_mm", "Hips", "mm", LOWER, "Largest distance of a hip from its mean place, beyond that of the training part."
)
BORDER_STEP_RATIO = _metric(
    "border_step_ratio", "Steps at borders", "", TRUTH, "Mean step into a window from elsewhere, over all others."
)
FROZEN_FRAMES = _metric(
    "frozen_frames", "Frozen frames", "", LOWER, "Frames equal to the frame before, where the recorded ones are not."
)
WRIST_SPEED_P50 = _metric("wrist_speed_p50", "Wrist speed, median", "m/s", TRUTH, "Median speed of both wrists.")
WRIST_SPEED_P95 = _metric(
    "wrist_speed_p95", "Wrist speed, 95th percentile", "m/s", TRUTH, "95th percentile of both wrists' speeds."
)
STROKE_LAG = _metric(
    "stroke_lag_s",
    "Stroke lag",
    "s",
    LOWER,
    "Median time from a wrist's fastest moment to the nearest onset among the louder half.",
)
SHOWN = (BONE, HAND_ROOT, HIP, BORDER_STEP_RATIO, FROZEN_FRAMES, WRIST_SPEED_P50, WRIST_SPEED_P95, JERK)

# ---- of HA2G's tables (docs/ha2g_metrics.md): by feature network, and by how motion beats are found ------------------

NETS = {
    "expressive": "expressive",
    "expressive_compat": "expressive, as released",
    "trimodal": "trimodal",
    "trimodal_compat": "trimodal, as released",
}


def _by_net(names, label, about, better=LOWER):
    """{net: name} of one metric by each of `NETS`."""
    pairs = zip(NETS, names, strict=True)
    return {net: _metric(name, f"{label} ({NETS[net]})", "", better, about) for net, name in pairs}


FGD_BY_NET = _by_net(
    ("fgd_expressive", "fgd_expressive_compat", "fgd_trimodal", "fgd_trimodal_compat"),
    "FGD to test truth",
    "Fréchet distance of the latents of all 34-frame windows, 10 frames apart, to those of the recordings.",
)
FGD_TRAIN_BY_NET = _by_net(
    ("fgd_train_expressive", "fgd_train_expressive_compat", "fgd_train_trimodal", "fgd_train_trimodal_compat"),
    "FGD to training part",
    "The same to the training part: the recordings' own is the noise floor.",
)
DIVERSITY_BY_NET = _by_net(
    ("diversity_expressive", "diversity_expressive_compat", "diversity_trimodal", "diversity_trimodal_compat"),
    "Diversity",
    "Mean distance of 500 random pairs of windows, as sums of absolute differences.",
    TRUTH,
)
DIVERSITY_BATCHES_BY_NET = _by_net(
    (
        "diversity_batches_expressive",
        "diversity_batches_expressive_compat",
        "diversity_batches_trimodal",
        "diversity_batches_trimodal_compat",
    ),
    "Diversity of batches",
    "Diversity as released code draws it, for comparison with its figures alone.",
    TRUTH,
)
WINDOWS = _metric("windows", "Windows", "", TRUTH, "How many windows FGD and diversity are taken of.")

MEASURED, TED, EXPRESSIVE, LOW_PASSED = "measured", "TED", "Expressive", "low-passed"
BEATS = (MEASURED, TED, EXPRESSIVE, LOW_PASSED)  # by the measured threshold, by published ones, and of smoothed motion


def _by_beats(names, label, about, unit="", better=HIGHER):
    """{way: name} of one metric by each of `BEATS`."""
    pairs = zip(BEATS, names, strict=True)
    return {
        way: name if name in KNOWN else _metric(name, f"{label} ({way})", unit, better, about) for way, name in pairs
    }


BC = _by_beats(
    ("bc", "bc_0.03", "bc_0.001", "bc_low_passed"),
    "BC",
    "Mean over all onsets of how close a motion beat is, 0 to 1; clips without a beat score 0.",
)
BC_WITHOUT_STILL = _by_beats(
    ("bc_without_still", "bc_without_still_0.03", "bc_without_still_0.001", "bc_without_still_low_passed"),
    "BC without still clips",
    "The same without the clips that have no beat.",
)
BC_EXCESS = _by_beats(
    ("bc_excess", "bc_excess_0.03", "bc_excess_0.001", "bc_excess_low_passed"),
    "BC over chance",
    "BC less what it is when the onsets are rotated in time: what timing adds.",
)
BC_BEAT_RATE = _by_beats(
    (BEAT_RATE, "beat_rate_0.03", "beat_rate_0.001", "beat_rate_low_passed"),
    "Motion beats",
    "Motion beats a second.",
    "1/s",
    TRUTH,
)
BC_RELEASED = _metric(
    "bc_compat", "BC as released", "", HIGHER, "BC of windows with onsets of their own; windows without a beat skipped."
)
CLIPS_SILENT = _metric("clips_silent", "Silent clips", "", TRUTH, "Clips without an onset, which have no score.")
CLIPS_STILL = _metric("clips_still", "Still clips", "", TRUTH, "Clips without a motion beat.")
ONSETS = _metric("onsets", "Onsets", "", TRUTH, "How many onsets the speech has.")
GENEA_JERK = _metric("genea_jerk", "Average jerk", "cm/s^3", TRUTH, "Mean norm of third differences (GENEA's AJ).")
GENEA_ACCELERATION = _metric(
    "genea_acceleration", "Average acceleration", "cm/s^2", TRUTH, "Mean norm of second differences (GENEA's AA)."
)
GENEA_HELLINGER_SPEED = _metric(
    "genea_hellinger_speed",
    "Hellinger distance of speeds",
    "",
    LOWER,
    "Distance of the histograms of all joints' speeds from the recordings'.",
)
GENEA_HELLINGER_ACCELERATION = _metric(
    "genea_hellinger_acceleration",
    "Hellinger distance of accelerations",
    "",
    LOWER,
    "Distance of the histograms of all joints' accelerations from the recordings'.",
)
GENEA_CCA_GLOBAL = _metric(
    "genea_cca_global",
    "CCA, one fit a speaker",
    "",
    HIGHER,
    "First canonical correlation with the recorded motion, one fit for all clips of a speaker.",
)
GENEA_CCA_PER_CLIP = _metric(
    "genea_cca_per_clip", "CCA, one fit a clip", "", HIGHER, "The same fitted anew for every clip."
)
