"""The report of a run: records, schema, page, joining."""
