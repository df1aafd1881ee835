"""The ray caster: exact hits of rays on the world."""
