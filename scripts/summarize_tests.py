#!/usr/bin/python3
"""Prints what a ctest run skipped and why, and the closing line of scripts/test.sh.

usage: summarize_tests.py BUILD_FOLDER CTEST_EXIT_CODE EXTRA_PASSED EXTRA_FAILED EXTRA_SKIPPED
Exits with 1 when anything failed or nothing ran."""
import collections
import os
import re
import sys
import xml.etree.ElementTree as ElementTree

# What a test program prints about the cases it leaves out: "Skipped" by GoogleTest with the reason on the next line.
GTEST_SKIP = re.compile(r"^(?P<place>\S+): Skipped\n(?P<reason>.*)$", re.MULTILINE)


def completion_of(test):
    """What ctest says of how it ended: Completed, Failed, Timeout, SKIP_RETURN_CODE=77, Disabled ..."""
    return test.findtext("Results/NamedMeasurement[@name='Completion Status']/Value") or ""


def reason_of(test, output):
    """Why a whole test was skipped: what its cases say, else the last line it printed, else what ctest says."""
    skip = GTEST_SKIP.search(output)
    if skip and skip.group("reason").strip():
        return skip.group("reason").strip()
    lines = output.strip().splitlines()
    return lines[-1] if lines else completion_of(test)


def tests_of(folder):
    """The elements of the last run of `ctest -T Test` in a build folder."""
    testing = os.path.join(folder, "Testing")
    with open(os.path.join(testing, "TAG")) as tag:
        results = os.path.join(testing, tag.readline().strip(), "Test.xml")
    return ElementTree.parse(results).getroot().findall("Testing/Test")


def main():
    folder = sys.argv[1]
    ctest_code, passed, failed, skipped = (int(argument) for argument in sys.argv[2:6])
    try:
        tests = tests_of(folder)
    except (OSError, ElementTree.ParseError) as error:
        print("no test results: %s" % error)
        tests = []
        failed += 1
    for test in tests:
        name = test.findtext("Name")
        output = test.findtext("Results/Measurement/Value") or ""
        status = test.get("Status")
        if status == "passed":
            passed += 1
            reasons = collections.Counter(skip.group("reason").strip() or skip.group("place")
                                          for skip in GTEST_SKIP.finditer(output))
            for reason, count in reasons.items():
                print("%d cases left out of %s: %s" % (count, name, reason))
        elif status == "notrun" and completion_of(test).startswith(("SKIP", "Disabled")):
            skipped += 1
            print("skipped: %s: %s" % (name, reason_of(test, output)))
        else:
            failed += 1
            print("failed: %s" % name)
    if ctest_code != 0 and failed == 0:
        failed += 1
        print("failed: ctest ended with %d" % ctest_code)
    print("%d passed, %d failed, %d skipped" % (passed, failed, skipped))
    return 1 if failed > 0 or passed == 0 else 0


if __name__ == "__main__":
    sys.exit(main())
