"""The file of an encoded mission: canonical bytes, both profiles' cryptography, records, signatures."""
