"""What can be seen: bodies and the roadside."""
