"""Headless pictures: EGL contexts, cameras, colour, depth and segmentation, files."""
