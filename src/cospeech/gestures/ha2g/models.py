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
from cospeech.gestures.generator import named, resolve

MODELS = tuple(named(learns="speakers"))
TASKS = {
    "ha2g": "hierarchy:HA2GTask",
    "trimodal": "trimodal:TrimodalTask",
    "seq2seq": "seq2seq:Seq2SeqTask",
    "speech2gesture": "speech2gesture:Speech2GestureTask",
    "joint_embedding": "joint_embedding:JointEmbeddingTask",
}


def ha2g_task(model, corpus, settings, seed):
    """The training `Task` of one of `MODELS` on a `Corpus`; `settings` is the budget's section of that name, a dict."""
    if model not in TASKS:
        raise CospeechError(f"model {model!r} is not known; known: {', '.join(MODELS)}")
    task = resolve(f"cospeech.gestures.ha2g.{TASKS[model]}")
    return task(corpus, task.settings_of(settings, corpus), seed)


def training_task(name, recordings, settings, seed):
    """The same on `Recordings`, whose `imagenet` HA2G's identity encoder starts from, if there are reference frames."""
    task = ha2g_task(name, recordings.corpus, settings, seed)
    if "picture" in task.description:
        from cospeech.gestures.ha2g.networks.identity import load_imagenet

        load_imagenet(task.generator.style.encoder, recordings.imagenet)
    return task
