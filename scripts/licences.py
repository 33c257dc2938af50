#!/usr/bin/env python3
"""Checks the licence of every crate in Cargo.lock against the permissive ones we accept, and that nalgebra is there once.

Works offline on what cargo has already fetched: `cargo metadata` gives each crate's SPDX expression.
"""
import json, re, subprocess, sys

ACCEPTED = {
    "MIT", "MIT-0", "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "ISC", "Zlib", "Unlicense", "0BSD", "CC0-1.0", "BSL-1.0",
    "Unicode-3.0", "Unicode-DFS-2016", "Apache-2.0 WITH LLVM-exception",
}


def accepted(expression):
    """Whether an SPDX expression can be met with accepted licences only (OR: any, AND: all)."""
    text = expression.replace("/", " OR ")
    tokens = re.findall(r"\(|\)|[^\s()]+(?: WITH [^\s()]+)?", text)
    at = 0

    def alternatives():
        nonlocal at
        ok = conjunction()
        while at < len(tokens) and tokens[at] == "OR":
            at += 1
            ok = conjunction() or ok
        return ok

    def conjunction():
        nonlocal at
        ok = single()
        while at < len(tokens) and tokens[at] == "AND":
            at += 1
            ok = single() and ok
        return ok

    def single():
        nonlocal at
        token = tokens[at]
        at += 1
        if token == "(":
            ok = alternatives()
            at += 1
            return ok
        return token in ACCEPTED

    return alternatives()


def main():
    host = re.search(r"host: (\S+)", subprocess.check_output(["rustc", "-vV"], text=True)).group(1)
    # Crates of other systems are neither fetched nor built here.
    metadata = json.loads(subprocess.check_output(["cargo", "metadata", "--format-version", "1", "--locked", "--filter-platform", host]))
    bad = [f"{p['name']} {p['version']}: {p['license'] or 'no licence named'}" for p in metadata["packages"] if not (p["license"] and accepted(p["license"]))]
    algebra = [p["version"] for p in metadata["packages"] if p["name"] == "nalgebra"]
    if len(algebra) != 1:
        bad.append(f"nalgebra must be there once, found {algebra}")
    for line in bad:
        print("not accepted:", line)
    print(f"{len(metadata['packages'])} crates, {len(bad)} not accepted")
    sys.exit(bool(bad))


main()
