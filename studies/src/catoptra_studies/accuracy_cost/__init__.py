"""The study of accuracy against cost: each way to render one frame, timed, bounded and compared.

`cost_study` measures renderers in this process and `localization_study` drives robots through
server processes; `cost_results` holds both, and the reports and plots are made of nothing else.
"""
