"""Put the tables of a run into docs/measured/: what stands between `measured from FILE` marks is replaced by the file.

    python tools/measured.py                        # from results/; or --results FOLDER

A mark is `<!-- measured from FILE -->` or `<!-- measured from FILE: column, column -->`, and `<!-- /measured -->` ends
it. FILE lies under the results: a CSV file with a heading line becomes a table for each subject, its cells written as
in the report; a text file, such as a benchmark's output, is shown as it is; `benchmarks` are the times and memory of a
run's jobs. What has no file is left as it is, and named.
"""

import argparse
import re
import subprocess
import sys
from pathlib import Path

from cospeech.errors import CospeechError
from cospeech.files import writing
from cospeech.render.pages.table_sections import text_tables

PAGES = Path(__file__).parent.parent / "docs" / "measured"
BLOCK = re.compile(
    r"<!-- measured from (?P<file>[^:>]+?)(: (?P<columns>[^>]+?))? -->\n.*?<!-- /measured -->", re.DOTALL
)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--results", type=Path, default=Path("results"), help="folder of a run")
    parser.add_argument("--pages", type=Path, default=PAGES, help="folder of the pages")
    arguments = parser.parse_args()
    for page in sorted(arguments.pages.glob("*.md")):
        before = page.read_text(encoding="utf-8")
        after = BLOCK.sub(lambda found: filled(found, arguments.results), before)
        if after != before:
            with writing(page) as temporary:
                temporary.write_text(after, encoding="utf-8")
            print(f"{page}: changed")


def filled(found, results):
    """The block of a match of `BLOCK`, with what its file says now, or as it was if there is no such file."""
    name, columns = found["file"], found["columns"]
    path = results / name
    if not path.exists():
        print(f"{path}: not there, its table stays as it is")
        return found[0]
    body = jobs(path) if path.is_dir() else content(path, columns and [one.strip() for one in columns.split(",")])
    mark = f"<!-- measured from {name}{f': {columns}' if columns else ''} -->"
    return f"{mark}\n{body.strip()}\n\n*Commit {commit()}, from `{name}`.*\n<!-- /measured -->"


def content(path, columns):
    if path.suffix != ".csv":
        return f"```\n{path.read_text(encoding='utf-8').rstrip()}\n```"
    return text_tables(path, columns)


def jobs(folder):
    """Markdown of a run's jobs by rule: how many, their seconds together, the largest memory."""
    lines = ["| rule | jobs | seconds in all | most memory, MB |", "| --- | --- | --- | --- |"]
    for rule in sorted(folder.iterdir()):
        rows = [_row(file) for file in ([rule] if rule.is_file() else sorted(rule.rglob("*.tsv")))]
        if rows:
            seconds, memory = sum(row[0] for row in rows), max(row[1] for row in rows)
            lines.append(f"| {rule.stem} | {len(rows)} | {seconds:.0f} | {memory:.0f} |")
    return "\n".join(lines)


def _row(path):
    """(seconds, megabytes) of a benchmark file of Snakemake; a short job has no memory measured, here 0."""
    head, *rows = (line.split("\t") for line in path.read_text(encoding="utf-8").splitlines())
    if not {"s", "max_rss"} <= set(head) or not rows:
        raise CospeechError(f"{path}: expected a benchmark file of Snakemake with the columns s and max_rss")
    values = dict(zip(head, rows[-1], strict=True))
    return float(values["s"]), 0.0 if values["max_rss"] in ("-", "NA") else float(values["max_rss"])


def commit():
    """The commit of the code, with a + if it has been changed since."""
    said = subprocess.run(
        ["git", "describe", "--always", "--dirty=+", "--exclude=*"], cwd=PAGES, capture_output=True, text=True
    )
    return said.stdout.strip() or "unknown"


if __name__ == "__main__":
    try:
        main()
    except CospeechError as error:
        print(f"measured: error: {error}", file=sys.stderr)
        sys.exit(2)
