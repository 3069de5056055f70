"""The whole paper (Chaunsali, Kim & Yang 2018), claim by claim: its scenes, its claims, and what it leaves out.

| module | says |
|---|---|
| ``runs`` | which scenes go through which backends, and what came of it |
| ``measures`` | numbers of one run with their bars |
| ``claims_*`` | what the paper says beside what was found |
| ``effects`` | what each parameter and each piece of physics changes: the whole budget |
| ``theories`` | how far binary collisions and the adiabatic wave carry |
| ``pulses`` | the pulse and the fits of every scene |
| ``validity`` | where point contact and lumped mass hold |
| ``figures`` | figures 2 to 6 as numbers |
| ``study`` | all of it, in order |
"""
