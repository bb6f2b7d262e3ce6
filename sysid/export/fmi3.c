
/* FMI 3.0: the functions by the names and arguments of the standard (https://fmi-standard.org/docs/3.0.2). */
typedef void (*Log)(void *environment, int status, const char *category, const char *message);

static int report(const Instance *instance, int status, const char *message)
{
    const Log log = (Log)instance->log;
    if (log) log(instance->environment, status, status == ERROR ? "logStatusError" : "logStatusDiscard", message);
    return status;
}

EXPORT const char *FMI(GetVersion)(void)
{
    return "3.0";
}

EXPORT int FMI(SetDebugLogging)(Instance *i, bool on, size_t n, const char *const categories[])
{
    return OK;
}

EXPORT Instance *FMI(InstantiateModelExchange)(const char *name, const char *token, const char *resources, bool visible,
                                               bool logging, void *environment, Log log)
{
    return instance_of(name, token, true, environment, (Callback)log);
}

EXPORT Instance *FMI(InstantiateCoSimulation)(const char *name, const char *token, const char *resources, bool visible,
                                              bool logging, bool events, bool early, const uint32_t *required,
                                              size_t n, void *environment, Log log, Callback update)
{
    return instance_of(name, token, false, environment, (Callback)log);
}

EXPORT Instance *FMI(InstantiateScheduledExecution)(const char *name, const char *token, const char *resources,
                                                    bool visible, bool logging, void *environment, Log log,
                                                    Callback update, Callback lock, Callback unlock)
{
    return NULL;
}

EXPORT int FMI(EnterInitializationMode)(Instance *i, bool has_tolerance, double tolerance, double start, bool has_stop,
                                        double stop)
{
    start_at(i, start);
    return OK;
}

EXPORT int FMI(GetFloat64)(Instance *i, const uint32_t *references, size_t n, double *values, size_t n_values)
{
    return n == n_values ? get(i, references, n, values) : report(i, ERROR, "every variable is one number");
}

EXPORT int FMI(SetFloat64)(Instance *i, const uint32_t *references, size_t n, const double *values, size_t n_values)
{
    return n == n_values ? set(i, references, n, values) : report(i, ERROR, "every variable is one number");
}

EXPORT int FMI(DoStep)(Instance *i, double from, double h, bool no_return, bool *event, bool *terminate, bool *early,
                       double *last)
{
    const int status = advance(i, from, h);
    *event = *terminate = *early = false;
    *last = i->run.time;
    return status;
}

EXPORT int FMI(UpdateDiscreteStates)(Instance *i, bool *again, bool *terminate, bool *nominals, bool *values,
                                     bool *has_next, double *next)
{
    *again = *terminate = *nominals = *values = false;
    if (i->exchange) tick(&i->run);
    *has_next = i->exchange;
    *next = due(&i->run);
    return OK;
}

EXPORT int FMI(CompletedIntegratorStep)(Instance *i, bool no_return, bool *event, bool *terminate)
{
    *event = *terminate = false;
    return OK;
}

EXPORT int FMI(GetNumberOfContinuousStates)(Instance *i, size_t *n)
{
    *n = 0;
    return OK;
}

EXPORT int FMI(GetNumberOfEventIndicators)(Instance *i, size_t *n)
{
    *n = 0;
    return OK;
}

MODE(EnterStepMode)
MODE(EnterConfigurationMode)
MODE(ExitConfigurationMode)
MODE(EvaluateDiscreteStates)

EMPTY(GetContinuousStateDerivatives, double)

/* Variables of other types. */
#define TYPE(name, type) \
    EXPORT int FMI(Get##name)(Instance *i, const uint32_t *references, size_t n, type *values, size_t n_values) \
    { \
        return none(i, n); \
    } \
    EXPORT int FMI(Set##name)(Instance *i, const uint32_t *references, size_t n, const type *values, \
                              size_t n_values) \
    { \
        return none(i, n); \
    }
TYPE(Float32, float)
TYPE(Int8, int8_t)
TYPE(UInt8, uint8_t)
TYPE(Int16, int16_t)
TYPE(UInt16, uint16_t)
TYPE(Int32, int32_t)
TYPE(UInt32, uint32_t)
TYPE(Int64, int64_t)
TYPE(UInt64, uint64_t)
TYPE(Boolean, bool)
TYPE(String, char *)

LACKS(GetBinary, const uint32_t *r, size_t n, size_t *sizes, const uint8_t **v, size_t m)
LACKS(SetBinary, const uint32_t *r, size_t n, const size_t *sizes, const uint8_t *const *v, size_t m)
LACKS(GetClock, const uint32_t *r, size_t n, bool *v)
LACKS(SetClock, const uint32_t *r, size_t n, const bool *v)
LACKS(GetNumberOfVariableDependencies, uint32_t r, size_t *n)
LACKS(GetVariableDependencies, uint32_t r, size_t *e, uint32_t *of, size_t *oe, int *kinds, size_t n)
LACKS(GetDirectionalDerivative, const uint32_t *a, size_t n, const uint32_t *b, size_t m, const double *s, size_t k,
      double *d, size_t l)
LACKS(GetAdjointDerivative, const uint32_t *a, size_t n, const uint32_t *b, size_t m, const double *s, size_t k,
      double *d, size_t l)
LACKS(GetIntervalDecimal, const uint32_t *r, size_t n, double *v, int *q)
LACKS(GetIntervalFraction, const uint32_t *r, size_t n, uint64_t *c, uint64_t *f, int *q)
LACKS(GetShiftDecimal, const uint32_t *r, size_t n, double *v)
LACKS(GetShiftFraction, const uint32_t *r, size_t n, uint64_t *c, uint64_t *f)
LACKS(SetIntervalDecimal, const uint32_t *r, size_t n, const double *v)
LACKS(SetIntervalFraction, const uint32_t *r, size_t n, const uint64_t *c, const uint64_t *f)
LACKS(SetShiftDecimal, const uint32_t *r, size_t n, const double *v)
LACKS(SetShiftFraction, const uint32_t *r, size_t n, const uint64_t *c, const uint64_t *f)
LACKS(GetOutputDerivatives, const uint32_t *r, size_t n, const int32_t *o, double *v, size_t m)
LACKS(ActivateModelPartition, uint32_t r, double time)
