"""What the LOAM family shares: edges and planes, their pairs, and the way between scans."""
