"""The command ``eos-ref``: one module per command."""
