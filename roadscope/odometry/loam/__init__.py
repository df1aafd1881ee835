"""Common parts of the LOAM family: edges and planes, their pairs, and motion between scans."""
