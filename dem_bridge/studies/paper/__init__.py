"""Verify the whole paper (Chaunsali, Kim & Yang 2018): its scenes, its claims, and the effects that it leaves out.

| module | content |
|---|---|
| ``runs`` | the scenes that are run by each backend, and the results |
| ``measures`` | numbers of one run with their uncertainties |
| ``claims_*`` | the statements of the paper and the values that support or contradict them |
| ``effects`` | the effect of each parameter and each model term: the error budget of the predictions |
| ``theories`` | the errors of binary collisions and of the adiabatic wave |
| ``pulses`` | the pulse and the fits of every scene |
| ``validity`` | where contacts are points and bodies lumped masses |
| ``figures`` | figures 2 to 6 as data |
| ``texts`` | titles, captions and sentences, from ``studies/pages`` |
| ``study`` | the whole study, in order |
"""
