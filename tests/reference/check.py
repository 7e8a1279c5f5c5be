#!/usr/bin/env python3
"""Decodes all golden and conformance files and compares with what is expected of them, and with their traces.

One line a file; exit code 1 if any differs."""

import argparse
import io
import os
import sys
import time
import traceback

from arithmetic import Damaged
from expected import expected
from golden import describe
from reader import read_file
from tracing import Trace

TESTS = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
GOLDEN = os.path.join(TESTS, "golden", "v1")
CONFORMANCE = os.path.join(TESTS, "conformance")
SYMBOLS = 100


def read(folder, name, mode="r"):
    with open(os.path.join(folder, name), mode, **({} if "b" in mode else {"newline": ""})) as source:
        return source.read()


def difference(what, found, wanted):
    """The first line that differs, or None."""
    found, wanted = found.splitlines(), wanted.splitlines()
    for number, (a, b) in enumerate(zip(found + [""], wanted + [""]), 1):
        if a != b:
            return "%s, line %d: %r, expected %r" % (what, number, a, b)
    return None if len(found) == len(wanted) else "%s: %d lines, expected %d" % (what, len(found), len(wanted))


def golden_file(name, line):
    return difference("list.txt", describe(name, read_file(read(GOLDEN, name + ".lods", "rb"))), line)


def conformance_file(name, bless):
    out = io.StringIO()
    file = read_file(read(CONFORMANCE, name + ".lods", "rb"), Trace(out.write, SYMBOLS))
    found = difference(name + ".expected", expected(file), read(CONFORMANCE, name + ".expected"))
    if bless:
        with open(os.path.join(CONFORMANCE, name + ".trace"), "w", newline="\n") as target:
            target.write(out.getvalue())
    return found or difference(name + ".trace", out.getvalue(), read(CONFORMANCE, name + ".trace"))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bless", action="store_true", help="write the traces of the conformance files anew")
    arguments = parser.parse_args()
    jobs = []
    for line in read(GOLDEN, "list.txt").splitlines():
        name = line.split(":")[0]
        jobs.append(("golden/v1/" + name, lambda name=name, line=line: golden_file(name, line)))
    for entry in sorted(os.listdir(CONFORMANCE)):
        name, end = os.path.splitext(entry)
        if end == ".lods":
            jobs.append(("conformance/" + name, lambda name=name: conformance_file(name, arguments.bless)))
    bad = 0
    for name, job in jobs:
        start = time.monotonic()
        try:
            wrong = job()
        except (Damaged, OSError) as error:
            wrong = str(error)
        except Exception:
            wrong = traceback.format_exc()
        bad += wrong is not None
        print("%-32s %s  (%.1f s)" % (name, "equal" if wrong is None else wrong, time.monotonic() - start), flush=True)
    print("%d files, %d differ" % (len(jobs), bad))
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    main()
