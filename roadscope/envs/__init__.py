"""Traffic, world, ray caster, sensors and Gymnasium: each folder imports from those before it."""
