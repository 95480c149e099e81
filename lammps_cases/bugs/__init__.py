"""Bug reports that need nobody to install anything: a deck that tells PASS from FAIL by itself, and the text for it."""
