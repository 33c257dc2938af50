#!/usr/bin/env python3
"""Blob tracking by Python and OpenCV, the fastest straightforward way: imread, threshold, findContours, moments, nearest
neighbour from frame to frame. Prints processor seconds (medians; a busy machine does not change them much) and pairs per
processor second as JSON.

    track_opencv_contours.py SHOT [--sweetspot PROGRAM SESSION]

SHOT holds left/ and right/. With --sweetspot the program tracks the session's shot of that name right after, on the same
machine and on one core (-j 1), with and without spin. The OpenCV side finds centres of bright blobs in both pictures and
links them: no identity of markers, no ball among them, no space points, no deviations, no occlusion.
"""
import argparse
import json
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

LEVEL, LEAST_AREA, MOST_AREA, REACH_PX = 120, 6, 600, 12.0


def numbered(folder):
    return {int(re.findall(r"\d+", p.stem)[-1]): str(p) for p in folder.iterdir() if re.search(r"\d", p.stem)}


def contours(image):
    _, mask = cv2.threshold(image, LEVEL, 255, cv2.THRESH_BINARY)
    centres = []
    for contour in cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]:
        m = cv2.moments(contour)
        if LEAST_AREA <= m["m00"] <= MOST_AREA:
            centres.append((m["m10"] / m["m00"], m["m01"] / m["m00"]))
    return np.array(centres).reshape(-1, 2)


def link(tracks, centres):
    """Each track takes its nearest centre within reach; what is left begins a track."""
    free = set(range(len(centres)))
    for track in tracks:
        if not free:
            break
        some = list(free)
        d = np.hypot(*(centres[some] - track[-1]).T)
        k = int(d.argmin())
        if d[k] < REACH_PX:
            track.append(centres[some[k]])
            free.discard(some[k])
    tracks.extend([centres[i]] for i in free)


def track(shot, detect):
    folders = [numbered(shot / side) for side in ("left", "right")]
    numbers = sorted(set(folders[0]) & set(folders[1]))
    tracks = ([], [])
    for n in numbers:
        for side in range(2):
            link(tracks[side], detect(cv2.imread(folders[side][n], cv2.IMREAD_GRAYSCALE)))
    return len(numbers), [max((len(t) for t in side), default=0) for side in tracks]


def children_s():
    """Processor seconds of all finished child processes, the kernel's share included, as in process_time()."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def main(detect=contours, description=__doc__):
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("shot", type=Path)
    parser.add_argument("--sweetspot", nargs=2, metavar=("PROGRAM", "SESSION"))
    parser.add_argument("--runs", type=int, default=5)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    track(arguments.shot, detect)  # files into the cache
    seconds = []
    for _ in range(arguments.runs):
        start = time.process_time()
        pairs, longest = track(arguments.shot, detect)
        seconds.append(time.process_time() - start)
    peer = sorted(seconds)[len(seconds) // 2]
    result = {"pairs": pairs, "longest_tracks": longest, "opencv_s": peer, "opencv_pairs_per_s": pairs / peer}
    if arguments.sweetspot:
        program, session = arguments.sweetspot
        for name, words in (("with_spin", []), ("no_spin", ["--no-spin"])):
            seconds = []
            for _ in range(arguments.runs):
                with tempfile.TemporaryDirectory() as out:
                    Path(out, "calibration.json").write_bytes(Path(session, "results", "calibration.json").read_bytes())
                    start = children_s()
                    done = subprocess.run([program, "track", session, "--shot", arguments.shot.name, "--out", out, "-j", "1", *words], capture_output=True, text=True)
                    seconds.append(children_s() - start)
                    if done.returncode:
                        sys.exit(done.stderr)
            own = sorted(seconds)[len(seconds) // 2]
            result[f"sweetspot_{name}"] = {"s": own, "pairs_per_s": pairs / own, "times_opencv": peer / own}
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
