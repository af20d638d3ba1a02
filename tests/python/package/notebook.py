"""Runs a notebook where it lies, and prints as JSON what it put in, what was found, and the numbers of the files.

usage: notebook.py NOTEBOOK
"""

import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

# Runs after the last cell; the file stays as it is.
ASK = """
import json
print(json.dumps({
    "hidden": HIDDEN,
    "found": {f.effect: [p.value for p in f.parameters] for f in diagnosis.findings},
    "intervals": [p.interval.tolist() for f in diagnosis.findings for p in f.parameters],
    "gap": [diagnosis.gap.before, diagnosis.gap.after, diagnosis.gap.noise_floor],
    "report": json.loads((diagnosis.folder / "report.json").read_text()),
    "files": [path.is_file() for path in (diagnosis.urdf, diagnosis.mjcf, diagnosis.sdf, diagnosis.usd, diagnosis.report)],
}))
"""

path = Path(sys.argv[1])
notebook = nbformat.read(path, as_version=4)
notebook.cells.append(nbformat.v4.new_code_cell(ASK))
NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(path.parent)}}).execute()
print(notebook.cells[-1].outputs[0].text)
