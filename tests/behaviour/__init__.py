"""The behaviour oracle: recorded digests of whole runs, which a refactored tree must reproduce to the bit."""
