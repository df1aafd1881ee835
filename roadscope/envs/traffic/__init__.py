"""Who drives where: highway-env recorded, and scenarios of our own."""
