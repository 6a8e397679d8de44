"""One sentence of known times, as every recogniser, aligner and corpus writes it down."""

import json

TEXT = ["so", "the", "fish", "was", "huge"]
START, END = [0.2, 0.42, 0.52, 1.02, 1.25], [0.38, 0.5, 0.95, 1.2, 1.8]
ROWS = list(zip(TEXT, START, END, strict=True))
PLAIN = [{"word": w, "start": s, "end": e} for w, s, e in ROWS]


def ticks(seconds):
    return round(seconds * 1e7)


def google(**more):
    return [{"word": w, "startTime": f"{s:.3f}s", "endTime": f"{e:.3f}s"} | more for w, s, e in ROWS]


def azure(words):
    return {"nBest": [{"words": words}, {"words": [words[0]]}], "channel": 0}


TICKS = [{"Word": w, "Offset": ticks(s), "Duration": ticks(e - s)} for w, s, e in ROWS]
ISO = [{"word": w, "offset": f"PT{s}S", "duration": f"PT{e - s:.3f}S"} for w, s, e in ROWS]
AWS = [
    {"start_time": str(s), "end_time": str(e), "type": "pronunciation", "alternatives": [{"content": w}]}
    for w, s, e in ROWS
]
AWS.append({"type": "punctuation", "alternatives": [{"content": "."}]})
CPP = [{"text": f" {w}", "offsets": {"from": round(s * 1000), "to": round(e * 1000)}} for w, s, e in ROWS]
SECONDS = [
    {
        "word": w,
        "startTime": {"seconds": int(s), "nanos": round(s % 1 * 1e9)},
        "endTime": {"seconds": str(int(e)), "nanos": round(e % 1 * 1e9)},
    }
    for w, s, e in ROWS
]
DOCUMENTS = {
    "Whisper": {
        "text": "",
        "segments": [
            {"start": 0, "end": 1, "text": "so the", "words": PLAIN[:2]},
            {"start": 1, "end": 1, "text": "[Music]"},
            {"words": PLAIN[2:]},
        ],
    },
    "WhisperX": {"segments": [{"words": PLAIN}], "word_segments": PLAIN},
    "whisper.cpp, a word a segment": {"transcription": CPP},
    "whisper.cpp, tokens": {
        "transcription": [
            {
                "text": " so the fish was huge",
                "offsets": {},
                "tokens": [
                    {"text": "[_BEG_]", "offsets": {"from": 0, "to": 0}},
                    *CPP[:4],
                    {"text": " hu", "offsets": {"from": 1250, "to": 1500}},
                    {"text": "ge", "offsets": {"from": 1500, "to": 1800}},
                ],
            }
        ]
    },
    "Vosk": {"result": [{"conf": 1.0} | word for word in PLAIN], "text": "so the"},
    "Vosk, many": [{"result": PLAIN[:2]}, {"text": ""}, {"result": PLAIN[2:]}],
    "Google": {
        "results": [
            {"alternatives": [{"words": google()[:3]}, {"words": google()}]},
            {"alternatives": [{"words": google()[3:]}]},
        ]
    },
    "Google, speakers": {
        "results": [{"alternatives": [{"words": google()}]}, {"alternatives": [{"words": google(speakerTag=1)}]}]
    },
    "Google, an operation": {"done": True, "response": {"results": [{"alternatives": [{"words": SECONDS}]}]}},
    "Google, version 2": {
        "results": [
            {
                "alternatives": [
                    {"words": [{"word": w, "startOffset": f"{s}s", "endOffset": f"{e}s"} for w, s, e in ROWS]}
                ]
            }
        ]
    },
    "Google, a list": google(),
    "AWS": {"jobName": "talk", "results": {"transcripts": [{}], "items": AWS}},
    "Azure": {"RecognitionStatus": "Success", "NBest": [{"Words": TICKS}]},
    "Azure, many": [{"NBest": [{"Words": TICKS[:2]}]}, {"NBest": [{"Words": TICKS[2:]}]}],
    "Azure, batch": {"recognizedPhrases": [azure(ISO[:2]), azure(ISO[2:])]},
    "Azure, fast": {
        "phrases": [
            {
                "text": "",
                "words": [
                    {"text": w, "offsetMilliseconds": round(s * 1000), "durationMilliseconds": round((e - s) * 1000)}
                    for w, s, e in ROWS
                ],
            }
        ]
    },
    "Deepgram": {
        "results": {
            "channels": [{"alternatives": [{"transcript": "", "words": PLAIN}]}],
            "utterances": [{"words": PLAIN}],
        }
    },
    "AssemblyAI": {
        "audio_duration": 4,
        "words": [{"text": w, "start": round(s * 1000), "end": round(e * 1000)} for w, s, e in ROWS],
    },
    "Rev": {
        "monologues": [
            {
                "elements": [
                    *({"type": "text", "value": w, "ts": s, "end_ts": e} for w, s, e in ROWS),
                    {"type": "punct", "value": "."},
                ]
            }
        ]
    },
    "gentle": {"words": [{"startOffset": 0, "endOffset": 2, "case": "success"} | word for word in PLAIN]},
    "MFA": {"tiers": {"phones": {"entries": [[0.2, 0.3, "s"]]}, "words": {"entries": [[s, e, w] for w, s, e in ROWS]}}},
}


def grid(*tiers, comment=""):
    """A long TextGrid of (name, [(label, start, end)]) tiers."""
    head = f'File type = "ooTextFile"\nObject class = "TextGrid"\n\nxmin = 0\nxmax = 4 {comment}\ntiers? <exists>\n'
    text = head + f"size = {len(tiers)}\nitem []:\n"
    for i, (name, rows) in enumerate(tiers, 1):
        text += (
            f'item [{i}]:\nclass = "IntervalTier"\nname = "{name}"\nxmin = 0\nxmax = 4\nintervals: size = {len(rows)}\n'
        )
        text += "".join(
            f'intervals [{j}]:\nxmin = {s}\nxmax = {e}\ntext = "{w}"\n' for j, (w, s, e) in enumerate(rows, 1)
        )
    return text


PHONES = [
    (part, s + i * (e - s) / len(w), s + (i + 1) * (e - s) / len(w)) for w, s, e in ROWS for i, part in enumerate(w)
]
SENTENCE = [("so the fish was huge", 0.2, 1.8)]
CHRONOLOGICAL = '"Praat chronological TextGrid text file"\n0 4 ! Time domain.\n2 ! Number of tiers.\n'
CHRONOLOGICAL += '"IntervalTier" "words" 0 4\n"TextTier" "beats" 0 4\n\n! words:\n'
CHRONOLOGICAL += "".join(f'1 {s} {e}\n"{w}"\n\n2 {s}\n"x"\n' for w, s, e in ROWS)
CTM = "".join(f"talk {{}} {s:.2f} {e - s:.2f} {w} 0.9\n" for w, s, e in ROWS)
OTHER = CTM.replace("talk", "lecture_b").replace("fish", "bird")
BOTH = zip(
    CTM.format(*"AAAAA").splitlines(True),
    OTHER.replace("lecture_b", "talk").format(*"BBBBB").splitlines(True),
    strict=True,
)
ALTERNATIVES = "talk 1 * * <ALT_BEGIN>\ntalk 1 * * <ALT>\ntalk 1 3 1 x\ntalk 1 * * <ALT_END>\n"
IN_MS = [(w, f"{s * 1000:.0f}", f"{e * 1000:.0f}") for w, s, e in ROWS]
CUES = (
    "WEBVTT\n\n00:00.200 --> 00:01.800 align:start position:0%\nso<00:00:00.420><c> the</c><00:00:00.520><c> fish</c>"
)
TEXTS = {
    "grid of phones first.TextGrid": grid(("MAU", PHONES), ("ORT-MAU", ROWS), ("KAN-MAU", ROWS[:1])),
    "grid of a speaker.TextGrid": grid(("ada - phones", PHONES), ("ada - words", ROWS)),
    "grid of sentences first.TextGrid": grid(("TRN", SENTENCE), ("words", ROWS)),
    "grid without names.TextGrid": grid(("a", PHONES), ("b", SENTENCE), ("c", ROWS)),
    "grid of comments.TextGrid": grid(("words", ROWS), comment='! was 3.9 and "trailing" 7'),
    "chronological.TextGrid": CHRONOLOGICAL,
    "talk.ctm": OTHER.format(*"11111") + CTM.format(*"11111"),
    "two channels.ctm": "".join(a + b for a, b in BOTH),
    "alternatives.ctm": CTM.format(*"11111") + ALTERNATIVES,
    "milliseconds.tsv": "word\tstart_ms\tend_ms\n" + "".join(f"{w}\t{s}\t{e}\n" for w, s, e in IN_MS),
    "audacity.tsv": "".join(f"{s}\t{e}\t{w}\n" for w, s, e in ROWS),
    "whisper, a word a row.tsv": "start\tend\ttext\n" + "".join(f"{s}\t{e}\t{w}\n" for w, s, e in IN_MS),
    "vosk.json": "".join(json.dumps({"result": [word]}, indent=1) + "\n" for word in PLAIN),
}
TEXTS |= {f"{name}.json": json.dumps(content) for name, content in DOCUMENTS.items()}
