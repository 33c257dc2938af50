#!/usr/bin/env python3
"""Blob tracking by Python and OpenCV, the usual way: imread, threshold, connectedComponentsWithStats, nearest neighbour.

    track_opencv_components.py SHOT [--sweetspot PROGRAM SESSION]

Everything else as in track_opencv_contours.py.
"""
import cv2

import track_opencv_contours as peer


def components(image):
    _, mask = cv2.threshold(image, peer.LEVEL, 255, cv2.THRESH_BINARY)
    n, _, stats, centroids = cv2.connectedComponentsWithStats(mask, connectivity=8)
    area = stats[1:n, cv2.CC_STAT_AREA]
    return centroids[1:n][(area >= peer.LEAST_AREA) & (area <= peer.MOST_AREA)]


if __name__ == "__main__":
    peer.main(components, __doc__)
