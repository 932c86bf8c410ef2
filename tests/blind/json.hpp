// Reads the JSON that the scorer meets: its own files and reconcile.json.
#pragma once

#include <cctype>
#include <cstdlib>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace blind {

/// A value that is not there reads as null, 0, "" or an empty list.
struct Json {
  enum class Kind { null, boolean, number, text, list, object } kind = Kind::null;
  double number = 0;
  std::string text;
  std::vector<Json> items;
  std::map<std::string, Json> members;

  const Json& operator[](const std::string& key) const {
    static const Json none;
    const auto found = members.find(key);
    return found == members.end() ? none : found->second;
  }

  /// Null when the text is not JSON.
  static Json parse(std::string_view text) {
    Reader reader{text};
    Json value = reader.value();
    return reader.good ? value : Json{};
  }

 private:
  struct Reader {
    std::string_view rest;
    bool good = true;

    void blanks() {
      while (!rest.empty() && std::isspace(static_cast<unsigned char>(rest.front())))
        rest.remove_prefix(1);
    }
    bool take(char c) {
      blanks();
      if (rest.empty() || rest.front() != c) return false;
      rest.remove_prefix(1);
      return true;
    }
    bool word(std::string_view w) {
      if (!rest.starts_with(w)) return false;
      rest.remove_prefix(w.size());
      return true;
    }
    std::string string() {
      std::string out;
      while (!rest.empty() && rest.front() != '"') {
        if (rest.front() == '\\' && rest.size() > 1) rest.remove_prefix(1);
        out += rest.front();
        rest.remove_prefix(1);
      }
      good = good && take('"');
      return out;
    }
    Json value() {
      Json v;
      blanks();
      if (rest.empty()) return good = false, v;
      if (take('{')) {
        v.kind = Kind::object;
        if (take('}')) return v;
        do {
          good = good && take('"');
          const std::string key = string();
          good = good && take(':');
          v.members[key] = value();
        } while (good && take(','));
        good = good && take('}');
      } else if (take('[')) {
        v.kind = Kind::list;
        if (take(']')) return v;
        do v.items.push_back(value());
        while (good && take(','));
        good = good && take(']');
      } else if (take('"')) {
        v.kind = Kind::text;
        v.text = string();
      } else if (word("true") || word("false")) {
        v.kind = Kind::boolean;
      } else if (!word("null")) {
        const std::string copy(rest.substr(0, 40));
        char* end = nullptr;
        v.number = std::strtod(copy.c_str(), &end);
        v.kind = Kind::number;
        good = good && end != copy.c_str();
        rest.remove_prefix(static_cast<std::size_t>(end - copy.c_str()));
      }
      return v;
    }
  };
};

}  // namespace blind
