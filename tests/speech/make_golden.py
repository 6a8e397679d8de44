"""Write sphinx_golden.npz: coefficients of Debian's `sphinx_fe` (sphinxbase-utils) for a synthetic sound.

Run from this folder where that program is installed: `python make_golden.py`.
"""

import subprocess
import tempfile
from pathlib import Path

import numpy as np

DEFAULTS = "-raw yes -input_endian little -samprate 16000 -frate 100 -wlen 0.025625 -round_filters yes -unit_area yes"
EXACT = f"{DEFAULTS} -transform legacy -dither no -remove_noise no -remove_silence no"


def synthetic_sound(seed, seconds=1.5):
    """(N,) int16 at 16 kHz: a chirp that swells over noise, a stretch of digital silence, and full scale once."""
    time = np.arange(round(seconds * 16000)) / 16000
    rng = np.random.default_rng(seed)
    chirp = np.sin(2 * np.pi * (80 + 2500 * time) * time) * (0.05 + 0.4 * np.abs(np.sin(7 * time)))
    sound = chirp + 0.01 * rng.normal(size=len(time))
    sound[len(sound) // 2 : len(sound) // 2 + 2400] = 0
    sound[5000:5100] = np.sign(sound[5000:5100])
    return np.clip(np.round(sound * 32767), -32768, 32767).astype(np.int16)


def sphinx_fe(pcm):
    """(M, 13) float32: what the program makes of int16 samples."""
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder, "sound.raw"), Path(folder, "sound.mfc")
        pcm.astype("<i2").tofile(source)
        command = ["sphinx_fe", "-i", source, "-o", target, *EXACT.split()]
        subprocess.run(command, check=True, capture_output=True)
        return np.frombuffer(target.read_bytes()[4:], "<f4").reshape(-1, 13)  # behind the number of values


if __name__ == "__main__":
    sound = synthetic_sound(seed=0)
    np.savez_compressed(Path(__file__).with_name("sphinx_golden.npz"), pcm=sound, mfcc=sphinx_fe(sound))
