"""rerun without its window: its check of the file, then the forces and arrows that it stores."""

import subprocess
import sys
from pathlib import Path

from mcap_compared import compared
from rerun.chunk import McapReader

folder = Path(sys.argv[1])
run = [str(Path(sys.executable).parent / "rerun"), "mcap"]
checked = subprocess.run([*run, "check", "--full", folder / "forces.mcap"], capture_output=True, text=True, check=True)
rows = [line.split()[0] for line in checked.stdout.splitlines() if "/" in line and line[0].isalpha()]
assert rows.count("ok") >= 10, checked.stdout
subprocess.run([*run, "convert", folder / "forces.mcap", "-o", folder / "forces.rrd"], capture_output=True, check=True)
messages = []
for chunk in McapReader(str(folder / "forces.mcap")).stream():
    batch = chunk.to_record_batch()
    for name in batch.schema.names:
        if name.endswith(":message"):
            messages += [(str(chunk.entity_path), row.as_py()[0]) for row in batch.column(name)]
print(f"found: `rerun mcap check` and `convert` say ok; {compared(folder, messages)}")
