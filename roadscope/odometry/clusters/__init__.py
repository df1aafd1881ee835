"""Zhang 2022's steps on clusters: segments, which of them move, features of each."""
