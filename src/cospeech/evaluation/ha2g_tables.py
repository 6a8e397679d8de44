"""HA2G's tables 1, 3 and 4 from evaluations of several networks over the speakers' test clips."""

from functools import partial

from cospeech.evaluation.columns import BC, DIVERSITY_BY_NET, FGD_BY_NET, FGD_TRAIN_BY_NET, MEASURED
from cospeech.evaluation.tables import write_csv
from cospeech.formats.result_table import headings

EXPRESSIVE, TRIMODAL = "expressive", "trimodal"
ABLATION = (FGD_BY_NET[EXPRESSIVE], FGD_TRAIN_BY_NET[EXPRESSIVE], BC[MEASURED], DIVERSITY_BY_NET[EXPRESSIVE])
TABLE_1 = (*ABLATION, FGD_BY_NET[TRIMODAL], FGD_TRAIN_BY_NET[TRIMODAL], DIVERSITY_BY_NET[TRIMODAL])
COLUMNS = {"ha2g_table_1": TABLE_1, "ha2g_table_3": ABLATION, "ha2g_table_4": ABLATION}  # of other tables: all


def write_ha2g(path, evaluations, rows=None, columns=None):
    """HA2G's Tables 1, 3 and 4 as CSV: a line for each row {name: label}, its number of runs, two columns a metric.

    None: all rows, all metrics.
    """
    write_csv(path, evaluations, columns, rows, {"method": "row", "runs": "runs"}, partial(headings, unit=""))
