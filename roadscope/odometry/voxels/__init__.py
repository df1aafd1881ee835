"""Maps of surfaces in voxels, and scans matched with them."""
