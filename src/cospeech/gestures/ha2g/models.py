"""HA2G and the four networks that it is compared with, by the name a configuration gives them.

| name | hears | published in |
| --- | --- | --- |
| `ha2g` | log-mel, words in training, speaker | Liu et al. 2022 |
| `trimodal` | wave, words, speaker | Yoon et al. 2020 |
| `seq2seq` | words | Yoon et al. 2019 |
| `speech2gesture` | log-mel | Ginosar et al. 2019 |
| `joint_embedding` | wave, words | Ahuja and Morency 2019, as ported for Trimodal's comparison |

The rows of HA2G's Tables 3 and 4 are settings of `ha2g` (`hierarchy.Settings`):

| row | settings |
| --- | --- |
| low, mid, high only | `audio_levels: [low]`, `[mid]`, `[high]` |
| without negatives of other times and clips | `in_level_negatives: false` |
| without negatives of low and mid | `cross_level_negatives: false` |
| without text | `text: false` |
| hearing words when generating, not published | `text_input: true` |
| holistic | `pose_hierarchy: none` |
| without hand hierarchy | `pose_hierarchy: body` |
| without body hierarchy | `pose_hierarchy: hands` |
| same audio for every level | `same_audio: true` |
| without physical loss | `weights: {physical: 0}` |
"""

from cospeech.errors import CospeechError

MODELS = ("ha2g", "trimodal", "seq2seq", "speech2gesture", "joint_embedding")


def ha2g_task(model, corpus, settings, seed):
    """The training `Task` of one of `MODELS` on a `Corpus`; `settings` is the budget's section of that name, a dict."""
    if model == "ha2g":
        from cospeech.gestures.ha2g.hierarchy import HA2GTask as Task
    elif model == "trimodal":
        from cospeech.gestures.ha2g.trimodal import TrimodalTask as Task
    elif model == "seq2seq":
        from cospeech.gestures.ha2g.seq2seq import Seq2SeqTask as Task
    elif model == "speech2gesture":
        from cospeech.gestures.ha2g.speech2gesture import Speech2GestureTask as Task
    elif model == "joint_embedding":
        from cospeech.gestures.ha2g.joint_embedding import JointEmbeddingTask as Task
    else:
        raise CospeechError(f"model {model!r} is not known; known: {', '.join(MODELS)}")
    return Task(corpus, Task.settings_of(settings, corpus), seed)
