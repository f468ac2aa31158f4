"""Lists what others have written that is delivered with Schuler, with its licence: docs/third-party.md.

Without argument, fails when the list is out of date; with --write, writes it. In: `cargo metadata`. What only tests, build
scripts and macros use is not delivered and not listed.
"""
import json
import subprocess
import sys
from pathlib import Path

LIST = Path("docs/third-party.md")
COMMAND = ["cargo", "metadata", "--format-version", "1", "--locked"]
# What is linked into a navigation computer, and everything that is delivered.
FLOWN = ["firmware", "schuler-c"]
DELIVERED = [*FLOWN, "schuler-recording", "schuler-explain", "host-sim"]

metadata = json.loads(subprocess.run(COMMAND, check=True, stdout=subprocess.PIPE).stdout)
packages = {package["id"]: package for package in metadata["packages"]}
nodes = {node["id"]: node["deps"] for node in metadata["resolve"]["nodes"]}


def is_macro(package):
    """Runs in the compiler alone."""
    return any("proc-macro" in target["kind"] for target in package["targets"])


def reached(names):
    """Ids of what these packages of ours need to run, themselves included."""
    left = [key for key in metadata["workspace_members"] if packages[key]["name"] in names]
    found = set()
    while left:
        key = left.pop()
        if key not in found:
            found.add(key)
            needed = [dep["pkg"] for dep in nodes[key] if any(kind["kind"] is None for kind in dep["dep_kinds"])]
            left += [key for key in needed if not is_macro(packages[key])]
    return found


flown, delivered = reached(FLOWN), reached(DELIVERED) - set(metadata["workspace_members"])
lines = ["""# What others have written

Delivered with Schuler, on whatever platform; what only tests and the compiler use is not listed. The licences in force are held by `deny.toml`. Made by
`python3 tests/dependencies/third_party.py --write`; `tests/run` fails when it is out of date.

| package | version | licence | in the navigation computer |
| --- | --- | --- | --- |
"""]
for key in sorted(delivered, key=lambda key: (packages[key]["name"], packages[key]["version"])):
    package = packages[key]
    mark = "yes" if key in flown else ""
    lines.append(f"| {package['name']} | {package['version']} | {package['license']} | {mark} |\n")
text = "".join(lines)
if "--write" in sys.argv:
    LIST.write_text(text, encoding="utf-8")
elif not LIST.exists() or LIST.read_text(encoding="utf-8") != text:
    sys.exit(f"{LIST} is out of date: python3 tests/dependencies/third_party.py --write")
