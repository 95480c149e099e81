"""Reports of a run: a page for people, a summary for a pull request, JUnit for a CI server.

Everything is made from the models of ``run.json`` and, where present, the per-atom arrays in ``fields/CASE.npz``.
"""
