#!/usr/bin/python3
"""Prints what a ctest run skipped and why, and the closing line of scripts/test.sh.

usage: summarize_tests.py CTEST_JUNIT_XML CTEST_EXIT_CODE EXTRA_PASSED EXTRA_FAILED
Exits with 1 when anything failed or nothing ran."""
import collections
import re
import sys
import xml.etree.ElementTree as ElementTree

# What a test program prints about the cases it leaves out: "Skipped" by GoogleTest with the reason on the next line.
GTEST_SKIP = re.compile(r"^(?P<place>\S+): Skipped\n(?P<reason>.*)$", re.MULTILINE)


def reason_of(case, output):
    """Why a whole test was skipped: what its cases say, else the last line it printed, else what ctest says."""
    skip = GTEST_SKIP.search(output)
    if skip and skip.group("reason").strip():
        return skip.group("reason").strip()
    lines = output.strip().splitlines()
    element = case.find("skipped")
    return lines[-1] if lines else element.get("message") if element is not None else case.get("status")


def main():
    junit, ctest_code, passed, failed = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
    skipped = 0
    try:
        cases = ElementTree.parse(junit).getroot().findall("testcase")
    except (OSError, ElementTree.ParseError) as error:
        print("no test results: %s" % error)
        cases = []
        failed += 1
    for case in cases:
        output = case.findtext("system-out") or ""
        status = case.get("status")
        if status == "run":
            passed += 1
        elif status in ("notrun", "disabled"):
            skipped += 1
            print("skipped: %s: %s" % (case.get("name"), reason_of(case, output)))
        else:
            failed += 1
            print("failed: %s" % case.get("name"))
        if status == "run":
            reasons = collections.Counter(skip.group("reason").strip() or skip.group("place")
                                          for skip in GTEST_SKIP.finditer(output))
            for reason, count in reasons.items():
                print("%d cases left out of %s: %s" % (count, case.get("name"), reason))
    if ctest_code != 0 and failed == 0:
        failed += 1
        print("failed: ctest ended with %d" % ctest_code)
    print("%d passed, %d failed, %d skipped" % (passed, failed, skipped))
    return 1 if failed > 0 or passed == 0 else 0


if __name__ == "__main__":
    sys.exit(main())
