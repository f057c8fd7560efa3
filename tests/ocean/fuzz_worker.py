"""
Opens many damaged copies of data sets in a process of its own, and reports what came of each.

Run as ``python fuzz_worker.py FOLDER FIRST COUNT FILE...``. Every copy must end in a valid ocean or in an
`OceanError` of one line, within a time and within a memory that the size of the file sets.
"""

import json
import os
import random
import resource
import sys
import traceback
import warnings
from pathlib import Path

from pymantaray.errors import OceanError
from pymantaray.ocean import open_ocean
from pymantaray.ocean.schema import validate_ocean

PEAK_BASE, PEAK_PER_BYTE = 1 << 30, 512  # bytes; what the reference page states
SECONDS = 15.0  # of processor, this process and those it started; the clock says how busy the machine is
TEMPTING = [0, 1, 2, 127, 128, 254, 255]
WORDS = [
    b"\xff\xff\xff\xff",
    b"\0\0\0\0",
    b"\x7f\xff\xff\xff",
    b"\x80\0\0\0",
    b"\xff\xff\xff\x7f",
    b"\0\0\0\x80",
]


def mutated(data, rng):
    """A copy with flipped bits, tempting bytes and words, cut, lengthened, or with a piece moved."""
    copy = bytearray(data)
    for _ in range(rng.choice([1, 1, 1, 2, 4, 16])):
        # half of the damage is done to the header, where sizes and offsets are
        i = rng.randrange(min(len(copy), 3000) if rng.random() < 0.5 else len(copy))
        kind = rng.randrange(8)
        if kind < 3:
            copy[i] ^= 1 << rng.randrange(8)
        elif kind == 3:
            copy[i] = rng.choice(TEMPTING)
        elif kind == 4:
            copy[i : i + 4] = rng.choice(WORDS)
        elif kind == 5:
            copy[i : i + 8] = rng.choice(WORDS) + rng.choice(WORDS)
        elif kind == 6 and rng.random() < 0.3:
            del copy[i:]
        elif kind == 7 and rng.random() < 0.3:
            j = rng.randrange(len(copy))
            copy[i : i + 64] = copy[j : j + 64]
        if not copy:
            break
    return bytes(copy)


def peak_bytes():
    """Highest resident memory so far of this process and of those it started."""
    scale = 1024 if sys.platform.startswith("linux") else 1
    own = scale * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    status = Path("/proc/self/status")
    if status.exists():  # ru_maxrss begins with what the process that started this one had
        lines = status.read_text(encoding="ascii").splitlines()
        own = 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))
    return max(own, scale * resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)


def processor_seconds():
    """Processor time so far of this process and of those that it has ended."""
    return sum(os.times()[:4])


def outcome(path, size, **options):
    """What opening did: valid, refused, or a line that says what is wrong with MantaRay."""
    before = peak_bytes()
    begin = processor_seconds()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            ocean = open_ocean(path, **options)
        validate_ocean(ocean)
        result = "valid"
    except OceanError as error:
        line = str(error)
        result = (
            "refused"
            if line and len(line.splitlines()) == 1 and line.isprintable()
            else f"not one line: {line!r}"
        )
    except BaseException:  # noqa: BLE001
        result = traceback.format_exc()
    if processor_seconds() - begin > SECONDS:
        result = f"took {processor_seconds() - begin:.0f} s"
    if peak_bytes() - before > PEAK_BASE + PEAK_PER_BYTE * size:
        result = f"took {(peak_bytes() - before) / 2**20:.0f} MiB for {size} bytes"
    return result


def main():
    folder, first, count, *names = sys.argv[1:]
    sources = [Path(name).read_bytes() for name in names]
    tally = {"valid": 0, "refused": 0}
    for k in range(int(first), int(first) + int(count)):
        rng = random.Random(k)
        data = mutated(sources[k % len(sources)], rng)
        path = Path(folder) / "mutant.nc"
        path.write_bytes(data)
        result = outcome(path, len(data), currents="rest")
        if result not in tally:
            path.replace(path.with_name(f"failed_{k}.nc"))
            sys.stdout.write(json.dumps({"seed": k, "file": names[k % len(names)], "result": result}) + "\n")
            sys.exit(1)
        tally[result] += 1
    sys.stdout.write(json.dumps(tally) + "\n")


if __name__ == "__main__":
    main()
