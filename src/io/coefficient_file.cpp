#include "servosense/io/coefficient_file.hpp"

namespace servosense {

Expected<MachineFile> with_coefficients(const MachineFile& machine) {
  const auto named = machine.text("tool", "coefficients");
  if (!named) return machine;
  auto file = MachineFile::read(machine.beside(*named));
  if (!file) return file.error();
  for (const std::string& section : file->sections())
    if (section != "tool")
      return data_error(file->where(section) + ": a coefficient file holds [tool] alone, not [" +
                        section + "]; move it to the machine file");
  MachineFile joined = machine;
  joined.remove("tool", "coefficients");
  bool any = false;
  for (const char* key : kCoefficientKeys) {
    const auto value = file->number("tool", key);
    if (!value) continue;
    if (machine.has("tool", key))
      return data_error(machine.where("tool", key) + ": " + key + " stands in " + file->name() +
                        ", too, which coefficients names; remove one of the two");
    joined.set("tool", key, *value);
    any = true;
  }
  if (!any)
    return data_error(file->name() +
                      ": there are no coefficients in [tool]; write them with "
                      "'servosense identify cutting --coefficients'");
  return joined;
}

}  // namespace servosense
