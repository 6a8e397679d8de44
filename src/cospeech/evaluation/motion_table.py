"""results/tables/motion.csv: is the motion whole, does it flow, is it as lively as the speaker, and in time?"""

from cospeech.evaluation.columns import BEAT_EXCESS, FGD_TRAIN, SHOWN, STROKE_LAG, SYNCHRONY
from cospeech.evaluation.tables import summarise
from cospeech.formats.result_table import write_table

HEADINGS = ("subject", "row", "seeds", *SHOWN, SYNCHRONY, "synchrony_deviation", BEAT_EXCESS, STROKE_LAG, FGD_TRAIN)


def write_motion(path, shown, judged):
    """A line a subject and row: of the motion as it is shown, and what the summary finds of the same clips.

    shown : Evaluations by `MotionMetrics`, in the order of the lines. judged : Evaluations by `SummaryMetrics` of the
    same rows and seeds; its jerk is not shown, being of low-passed motion. "n/a" where a number does not apply.
    """
    found = {(line.subject, line.row): line for line in summarise(judged)}
    lines = []
    for line in summarise(shown):
        other = found[line.subject, line.row]
        timing = other.mean[SYNCHRONY], other.deviation[SYNCHRONY], other.mean[BEAT_EXCESS], line.mean[STROKE_LAG]
        numbers = (*(line.mean[name] for name in SHOWN), *timing, other.mean[FGD_TRAIN])
        lines.append([line.subject, line.row, line.runs, *numbers])
    write_table(path, HEADINGS, lines)
