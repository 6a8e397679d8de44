"""Makes fasttext_tiny.bin and fasttext_tiny.json with Facebook's fastText (`pip install fasttext-wheel "numpy<2"`)."""

import json
from pathlib import Path

import fasttext

HERE = Path(__file__).parent
TEXTS = HERE.parents[1] / "src" / "cospeech" / "demo" / "texts"

text = " ".join((TEXTS / name).read_text().lower() for name in ("stars.txt", "soup.txt"))
(HERE / "words.txt").write_text(text + " café naïve café naïve straße straße café naïve straße " * 4)
model = fasttext.train_unsupervised(
    str(HERE / "words.txt"), model="skipgram", dim=5, bucket=300, minCount=4, minn=3, maxn=6, epoch=2, thread=1
)
(HERE / "words.txt").unlink()
model.save_model(str(HERE / "fasttext_tiny.bin"))
known = [word for word in model.words[:10] if word != "</s>"]
words = [*known, "café", "straße", "unheard", "xylophone", "a"]
vectors = {word: [float(x) for x in model.get_word_vector(word)] for word in words}
(HERE / "fasttext_tiny.json").write_text(json.dumps(vectors, ensure_ascii=False))
