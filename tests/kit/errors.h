// errors.h: the error that a call must end with.
#pragma once

#include "basics.h"

#include <doctest/doctest.h>

#include <string>

namespace amps_test {

struct Thrown {
  ErrorCode code;
  std::string text;
};

/// The amps::Error of a call that must throw one, with a text that says something, in one line.
template <class Call>
Thrown thrown_by(const Call& call) {
  try {
    call();
  } catch (const Error& error) {
    const std::string text = error.what();
    CAPTURE(text);
    CHECK((text.size() > 20 && text.find('\n') == std::string::npos));
    return {error.code(), text};
  }
  FAIL("no error was thrown");
  return {ErrorCode::kInternal, ""};
}

template <class Call>
ErrorCode error_of(const Call& call) {
  return thrown_by(call).code;
}

template <class Call>
std::string error_text(const Call& call) {
  return thrown_by(call).text;
}

}  // namespace amps_test
