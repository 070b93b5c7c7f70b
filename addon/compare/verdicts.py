"""The words of a comparison's verdict: for the command line's JSON and for the window."""

# Nothing differs, and what was to be found would have been; something differs beyond noise; there is too much noise.
AGREES, DIFFERS, UNDECIDED = "agrees", "differs", "undecided"
