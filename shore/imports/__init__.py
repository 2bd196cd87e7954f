"""`wayfix import`: recordings of others become logs like those of a live run.

    file -> kinds (what is it?) -> a reader of that kind -> plan (when?) -> cut (frames) -> write (filters, log)

Serial recordings go through the boat's own decoders (`wayfix-onboard convert`) instead of a reader.
"""
