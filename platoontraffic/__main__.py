from platoontraffic.cli.entry import main

main()
