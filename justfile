# Everything that the continuous checks run.
check:
    ./.ci/run
