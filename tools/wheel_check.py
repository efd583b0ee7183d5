"""Build the wheel as a release would, install it where nothing else is, and use it from an empty folder.

The wheel is built from the source distribution, so that a file missing from either is noticed. Only what the
wheel requires is installed, at the locked versions: a package that is used but not declared is noticed too.
"""

import os
import re
import subprocess
import sys
import tempfile
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("coevo", "behaviors", "analysis")
COMMANDS = (
    "coevo evolve smoke --out run",
    "coevo skills",
    "coevo play run",
    "coevo inspect run",
    "coevo reproduce categories smoke --teams 1",
    "coevo learn chapter3/literal-shoot --trials 10 --games 20 --out learned",
)


def main() -> int:
    """Run the check; the exit code is 1 if the wheel lacks a file or one of its commands fails."""
    with tempfile.TemporaryDirectory(prefix="coevo-wheel-") as folder:
        wheel = _build(Path(folder, "dist"))
        if complaints := _complaints(wheel):
            print(f"{wheel.name}: {'; '.join(complaints)}", file=sys.stderr)
            return 1
        bin_folder = _install(wheel, Path(folder, "venv"))
        empty = Path(folder, "empty")
        empty.mkdir()
        # Only what a new user's shell has: no path into the checkout.
        kept = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        environment = kept | {"PATH": f"{bin_folder}{os.pathsep}{os.environ['PATH']}"}
        for command in COMMANDS:
            print(f"$ {command}", flush=True)
            program, *arguments = command.split()
            code = subprocess.run(
                [bin_folder / program, *arguments], cwd=empty, env=environment, check=False
            ).returncode
            if code != 0:
                print(f"the installed wheel failed: '{command}' exited with {code}", file=sys.stderr)
                return 1
    print("The wheel works from an empty folder.")
    return 0


def _build(folder: Path) -> Path:
    """Build the source distribution, and the wheel from it."""
    print("Building the wheel ...", flush=True)
    _python(sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, ROOT, quiet=True)
    (wheel,) = folder.glob("*.whl")
    return wheel


def _complaints(wheel: Path) -> list[str]:
    """What is missing from the wheel, and what should not be in it."""
    with zipfile.ZipFile(wheel) as archive:
        inside = set(archive.namelist())
    expected = {f"{package}/py.typed" for package in PACKAGES}.union(_kept_files())
    missing = sorted(expected - inside)
    strange = sorted(name for name in inside - expected if ".dist-info/" not in name)
    return [f"lacks {name}" for name in missing] + [f"should not hold {name}" for name in strange]


def _kept_files() -> list[str]:
    """Where in the wheel all files of the packages, and all recipes of runs, belong that git keeps, or would keep."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "--", *PACKAGES, "runs/**.toml"],  # noqa: S607 - any git
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    ).stdout.splitlines()
    return [re.sub("^runs/", "coevo/presets/", name) for name in listed if (ROOT / name).is_file()]


def _install(wheel: Path, folder: Path) -> Path:
    """Install the wheel and what it requires, and return the folder of its programs."""
    print("Installing it in a fresh environment ...", flush=True)
    venv.create(folder, with_pip=True)
    bin_folder = folder / "bin"
    # pip takes hashes in a constraints file as a demand for hashes everywhere, the wheel's own too.
    lock = (ROOT / "requirements.lock").read_text()
    pins = re.findall(r"^\w[^\\\n]*==[^\\\n]*", lock, re.MULTILINE)
    constraints = folder / "constraints.txt"
    constraints.write_text("\n".join(pins) + "\n")
    pip = (bin_folder / "python", "-m", "pip", "--disable-pip-version-check")
    _python(*pip, "install", "-qq", "--only-binary", ":all:", "--constraint", constraints, wheel)
    _python(*pip, "check", quiet=True)
    return bin_folder


def _python(*command: str | Path, quiet: bool = False) -> None:
    """Run a command; where it is quiet, its output is shown only if it fails."""
    done = subprocess.run(
        command,
        check=False,
        stdout=subprocess.PIPE if quiet else None,
        stderr=subprocess.STDOUT if quiet else None,
        text=True,
    )
    if done.returncode != 0:
        print(done.stdout or "", file=sys.stderr)
        sys.exit(f"'{' '.join(map(str, command))}' exited with {done.returncode}")


if __name__ == "__main__":
    sys.exit(main())
