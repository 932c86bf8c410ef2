// A program that reads a machine file, and a trace where the adapter layer is there.
#include <servosense/io/machine_file.hpp>
#ifndef WITHOUT_HAL
#include <servosense/hal/sample_source.hpp>
#endif

#include <iostream>

int main() {
  auto machine = servosense::MachineFile::parse("[machine]\nname = mill\n", "consumer.ini");
  if (!machine) {
    std::cout << machine.error().sentence << '\n';
    return 1;
  }
  std::cout << machine->text("machine", "name").value_or("?") << '\n';
#ifndef WITHOUT_HAL
  auto reader = servosense::TraceReader::open("/nonexistent/trace.csv");
  if (reader) return 2;
#endif
  return 0;
}
