"""The paper's experiments: which runs a table needs, running them, and the tables themselves."""
