"""Images of the world: rasterisation, lighting, shading."""
