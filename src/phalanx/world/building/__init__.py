"""A building and what robots' senses and wheels make of it."""
