from platoontraffic.cli import main

main()
