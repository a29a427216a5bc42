"""The 71 phenomena: one file each, the index in the file name."""
