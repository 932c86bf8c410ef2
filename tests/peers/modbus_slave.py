"""A Modbus slave by pymodbus 3: modbus_slave.py tcp PORT | rtu DEVICE

Registers 100 to 104 count the requests, in three types: uint32, int16 (modulo 30000), float32. Prints
a line when it serves.
"""
import asyncio
import struct
import sys

from pymodbus.datastore import ModbusServerContext, ModbusSlaveContext, ModbusSparseDataBlock
from pymodbus.server import StartAsyncSerialServer, StartAsyncTcpServer
from pymodbus.transaction import ModbusRtuFramer


class Counting(ModbusSparseDataBlock):
    def __init__(self):
        super().__init__({n: 0 for n in range(100, 105)})
        self.requests = 0

    def getValues(self, address, count=1):
        self.requests += 1
        n = self.requests
        words = struct.unpack(">5H", struct.pack(">Ihf", n, n % 30000, n))
        return list(words[address - 100 : address - 100 + count])


async def main():
    slave = ModbusSlaveContext(hr=Counting(), zero_mode=True)
    context = ModbusServerContext(slaves=slave, single=True)
    kind, where = sys.argv[1:]
    print("serving", flush=True)
    if kind == "tcp":
        await StartAsyncTcpServer(context=context, address=("127.0.0.1", int(where)))
    else:
        await StartAsyncSerialServer(
            context=context, framer=ModbusRtuFramer, port=where, baudrate=115200, timeout=0.01
        )


asyncio.run(main())
