#!/usr/bin/env python3
"""The same calibration by Python and OpenCV, as most people would write it: findChessboardCorners + cornerSubPix on every
picture, calibrateCamera on each camera, stereoCalibrate on the pairs. Prints seconds and the result as JSON.

    calibrate_opencv.py SESSION [--sweetspot PROGRAM]

With --sweetspot the program calibrates the same session in the same run, before and after, on the same machine; wall and
processor seconds of both are printed, and their ratios (the faster of the two runs). The program's time includes its start,
hashes of the inputs, the axes and all files written.
No covariance, no choice of distortion terms, no held-out boards on the OpenCV side.
"""
import argparse
import json
import re
import resource
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path

import cv2
import numpy as np


def numbered(folder):
    return {int(re.findall(r"\d+", p.stem)[-1]): p for p in sorted(folder.iterdir()) if re.search(r"\d", p.stem)}


def corners(path, size):
    image = cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_GRAYSCALE)
    if image is None:
        return None, None
    found, c = cv2.findChessboardCorners(image, size, flags=cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not found:
        return image.shape[::-1], None
    cv2.cornerSubPix(image, c, (5, 5), (-1, -1), (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4))
    return image.shape[::-1], c


def calibrate(session):
    settings = tomllib.loads((session / "session.toml").read_text())["calibration"]
    size = (settings["board_columns"], settings["board_rows"])
    board = np.zeros((size[0] * size[1], 3), np.float32)
    board[:, :2] = np.mgrid[0 : size[0], 0 : size[1]].T.reshape(-1, 2) * settings["square_m"]
    folder = session / settings["images"]
    left, right = numbered(folder / "left"), numbered(folder / "right")
    pairs, image_size = [], None
    for n in sorted(set(left) & set(right)):
        sl, cl = corners(left[n], size)
        sr, cr = corners(right[n], size)
        image_size = image_size or sl or sr
        if cl is not None and cr is not None:
            pairs.append((cl, cr))
    after_corners = time.perf_counter()
    objects = [board] * len(pairs)
    lefts, rights = [p[0] for p in pairs], [p[1] for p in pairs]
    flags = cv2.CALIB_FIX_K3
    _, k1, d1, _, _ = cv2.calibrateCamera(objects, lefts, image_size, None, None, flags=flags)
    _, k2, d2, _, _ = cv2.calibrateCamera(objects, rights, image_size, None, None, flags=flags)
    rms, k1, d1, k2, d2, r, t, _, _ = cv2.stereoCalibrate(
        objects, lefts, rights, k1, d1, k2, d2, image_size,
        flags=cv2.CALIB_USE_INTRINSIC_GUESS | flags,
        criteria=(cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-6),
    )
    return after_corners, {"pairs": len(pairs), "rms_px": rms, "left_fx": k1[0, 0], "right_fx": k2[0, 0], "t_m": t.ravel().tolist()}


def run_program(arguments):
    """Wall and processor seconds of one calibration by the program."""
    with tempfile.TemporaryDirectory() as out:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        start = time.perf_counter()
        done = subprocess.run([arguments.sweetspot, "calibrate", arguments.session, "--out", out, "--force"], capture_output=True, text=True)
        wall = time.perf_counter() - start
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        sys.exit(done.stderr)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("session", type=Path)
    parser.add_argument("--sweetspot", type=Path)
    arguments = parser.parse_args()
    program = [run_program(arguments)] if arguments.sweetspot else []
    start, cpu = time.perf_counter(), time.process_time()
    after_corners, result = calibrate(arguments.session)
    end, cpu = time.perf_counter(), time.process_time() - cpu
    result["opencv"] = cv2.__version__
    result["opencv_s"] = {"corners": after_corners - start, "calibration": end - after_corners, "all": end - start, "processor": cpu}
    if arguments.sweetspot:
        program.append(run_program(arguments))
        wall, processor = min(p[0] for p in program), min(p[1] for p in program)
        result["sweetspot_s"] = {"all": wall, "processor": processor}
        result["sweetspot_over_opencv"] = {"all": wall / (end - start), "processor": processor / cpu}
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
