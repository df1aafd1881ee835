"""What the package has learned, learned anew from train seeds or recorded data."""
