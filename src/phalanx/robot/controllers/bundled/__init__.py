"""The bundled controllers, one per file, which can be selected by the file's name (dispatch.py)."""
