"""Case files: tables of TOML that become a Case, or one sentence about a mistake.

text              TOML with variants and with values by size
axes              the table [sweep]
schema            every other key: its type, unit and meaning
case_gates        the gates of a file and the default gates
case              a Case at one size
citations         the papers and the software that a case rests on
"""
