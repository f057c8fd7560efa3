"""The loop and the clients of the documentation run."""

import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pymantaray.apps.service import RangingService

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def port(serve):
    return serve(RangingService("synthetic:beaufort"))


def test_the_loop_delivers_each_message_when_its_sound_arrives(capsys):
    runpy.run_path(str(ROOT / "examples/service_loop.py"), run_name="__main__")
    lines = capsys.readouterr().out.splitlines()
    heard = [line for line in lines if " hears " in line and "nothing" not in line]
    times = [float(line.split()[0]) for line in heard]
    assert times == sorted(times)
    assert len(lines) >= 12 * 2  # twelve slots, two others at least get there in the run's time
    assert all(abs(float(re.search(r"([-+ ][\d.]+) m off", line)[1])) < 250.0 for line in heard)


@pytest.mark.network
def test_the_client_asks_by_the_standard_library_alone(port):
    command = [
        sys.executable,
        "-S",
        str(ROOT / "examples/service_client.py"),
        str(port),
    ]  # -S: no site-packages
    out = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    assert out[0] == "Beaufort Sea (synthetic)"
    there, back = (
        next(line.split()[4] for line in out if line.startswith(who))
        for who in ("B hears A", "A hears B")
    )
    assert float(back) - 10.0 == pytest.approx(float(there), abs=1e-6)


@pytest.mark.network
def test_the_client_in_cpp_compiles_and_hears(port, tmp_path):
    source = (ROOT / "examples/service_client.cpp").read_text()
    shown = source.partition("// It prints\n//\n")[2].partition("\n\n")[0]
    printed = shown.replace("//     ", "") + "\n"
    compiler = shutil.which("g++") or shutil.which("c++")
    file = tmp_path / "ping.cpp"
    file.write_text(source.replace(":8642", f":{port}"))
    if compiler is None:
        pytest.skip("no C++ compiler")
    build = subprocess.run(
        [compiler, "-std=c++17", "-Wall", "-Wextra", "-o", tmp_path / "ping", file, "-lcurl"],
        capture_output=True,
        text=True,
        check=False,
    )
    if "No such file" in build.stderr or "cannot find -lcurl" in build.stderr:
        pytest.skip("libcurl or nlohmann/json is not installed")
    assert (build.returncode, build.stderr) == (0, "")
    out = subprocess.run([tmp_path / "ping"], capture_output=True, text=True, check=True).stdout
    number = r"\d+\.\d+"  # whose last digits are the machine's
    assert re.sub(number, "", out) == re.sub(number, "", printed)
    assert float(re.search(number, out)[0]) == pytest.approx(
        float(re.search(number, printed)[0]), rel=1e-12
    )
