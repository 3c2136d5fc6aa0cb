"""The bundled controllers, a file each: whatever declares itself here can be chosen by its name (dispatch.py)."""
