"""The files of a run: tables, metrics, data dictionary, provenance."""
