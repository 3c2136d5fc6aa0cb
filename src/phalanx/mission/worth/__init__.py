"""What a captured file is worth: by sums, and by really trying."""
