"""The world that sensors measure: bodies and the roadside."""
