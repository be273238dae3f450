from platoontraffic.cli.main import main

main()
