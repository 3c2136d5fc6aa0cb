"""The file format of encoded missions: canonical bytes, cryptography of both profiles, records, signatures."""
