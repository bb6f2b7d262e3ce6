
/* FMI 2.0: the functions by the names and arguments of the standard (https://fmi-standard.org, 2.0.5). */
#ifdef FMI2_FUNCTION_PREFIX
#define FMI_JOIN(a, b) a##b
#define FMI_NAME(prefix, name) FMI_JOIN(prefix, name)
#define FMI(name) FMI_NAME(FMI2_FUNCTION_PREFIX, fmi2##name)
#else
#define FMI(name) fmi2##name
#endif

typedef void (*Log)(void *environment, const char *name, int status, const char *category, const char *message, ...);
typedef struct {
    Log log;
    void *(*allocate)(size_t n, size_t size);
    void (*release)(void *memory);
    void (*finished)(void *environment, int status);
    void *environment;
} Callbacks;
typedef struct {
    int again, terminate, nominals, values, has_next;
    double next;
} EventInfo;

static int report(const Instance *instance, int status, const char *message)
{
    const Log log = (Log)instance->log;
    const char *category = status == ERROR ? "logStatusError" : "logStatusDiscard";
    if (log) log(instance->environment, instance->name, status, category, "%s", message);
    return status;
}

EXPORT const char *FMI(GetTypesPlatform)(void)
{
    return "default";
}

EXPORT const char *FMI(GetVersion)(void)
{
    return "2.0";
}

EXPORT int FMI(SetDebugLogging)(Instance *i, int on, size_t n, const char *const categories[])
{
    return OK;
}

EXPORT Instance *FMI(Instantiate)(const char *name, int type, const char *token, const char *resources,
                                  const Callbacks *callbacks, int visible, int logging)
{
    if (!callbacks) return NULL;
    return instance_of(name, token, type == 0, callbacks->environment, (Callback)callbacks->log);
}

EXPORT void FMI(FreeInstance)(Instance *i)
{
    release(i);
}

EXPORT int FMI(SetupExperiment)(Instance *i, int has_tolerance, double tolerance, double start, int has_stop,
                                double stop)
{
    start_at(i, start);
    return OK;
}

EXPORT int FMI(ExitInitializationMode)(Instance *i)
{
    i->run.running = true;
    return OK;
}

EXPORT int FMI(Reset)(Instance *i)
{
    begin(&i->run);
    return OK;
}

EXPORT int FMI(GetReal)(Instance *i, const uint32_t *references, size_t n, double *values)
{
    return get(i, references, n, values);
}

EXPORT int FMI(SetReal)(Instance *i, const uint32_t *references, size_t n, const double *values)
{
    return set(i, references, n, values);
}

EXPORT int FMI(DoStep)(Instance *i, double from, double h, int no_return)
{
    return advance(i, from, h);
}

EXPORT int FMI(GetFMUstate)(Instance *i, void **kept)
{
    return save(i, kept);
}

EXPORT int FMI(SetFMUstate)(Instance *i, void *kept)
{
    memcpy(&i->run, kept, sizeof(Run));
    return OK;
}

EXPORT int FMI(FreeFMUstate)(Instance *i, void **kept)
{
    free(*kept);
    *kept = NULL;
    return OK;
}

EXPORT int FMI(SerializedFMUstateSize)(Instance *i, void *kept, size_t *n)
{
    *n = sizeof(Run);
    return OK;
}

EXPORT int FMI(SerializeFMUstate)(Instance *i, void *kept, uint8_t *bytes, size_t n)
{
    return pack(i, kept, bytes, n);
}

EXPORT int FMI(DeSerializeFMUstate)(Instance *i, const uint8_t *bytes, size_t n, void **kept)
{
    return unpack(i, bytes, n, kept);
}

EXPORT int FMI(SetTime)(Instance *i, double time)
{
    i->run.time = time;
    return OK;
}

EXPORT int FMI(NewDiscreteStates)(Instance *i, EventInfo *event)
{
    tick(&i->run);
    memset(event, 0, sizeof *event);
    event->has_next = 1;
    event->next = due(&i->run);
    return OK;
}

EXPORT int FMI(CompletedIntegratorStep)(Instance *i, int no_return, int *event, int *terminate)
{
    *event = *terminate = 0;
    return OK;
}

/* A change of mode, with nothing to do. */
#define MODE(name) \
    EXPORT int FMI(name)(Instance *i) \
    { \
        return OK; \
    }
MODE(EnterInitializationMode)
MODE(EnterEventMode)
MODE(EnterContinuousTimeMode)
MODE(Terminate)
MODE(CancelStep)

/* Vectors of no continuous states and no event indicators. */
#define EMPTY(name, type) \
    EXPORT int FMI(name)(Instance *i, type *values, size_t n) \
    { \
        return n == 0 ? OK : report(i, ERROR, "the model has no continuous states and no event indicators"); \
    }
EMPTY(SetContinuousStates, const double)
EMPTY(GetDerivatives, double)
EMPTY(GetEventIndicators, double)
EMPTY(GetContinuousStates, double)
EMPTY(GetNominalsOfContinuousStates, double)

static int none(const Instance *i, size_t n)
{
    return n == 0 ? OK : report(i, ERROR, "all variables of the model are of type Real");
}

/* Variables of other types. */
#define TYPE(name, type) \
    EXPORT int FMI(Get##name)(Instance *i, const uint32_t *references, size_t n, type *values) \
    { \
        return none(i, n); \
    } \
    EXPORT int FMI(Set##name)(Instance *i, const uint32_t *references, size_t n, const type *values) \
    { \
        return none(i, n); \
    }
TYPE(Integer, int)
TYPE(Boolean, int)
TYPE(String, char *)

/* What the model description does not offer: the arguments are not looked at. */
#define LACKS(name, ...) \
    EXPORT int FMI(name)(Instance *i, __VA_ARGS__) \
    { \
        return report(i, ERROR, "fmi2" #name " is not offered by the model"); \
    }
LACKS(GetDirectionalDerivative, const uint32_t *a, size_t n, const uint32_t *b, size_t m, const double *s, double *d)
LACKS(SetRealInputDerivatives, const uint32_t *r, size_t n, const int *o, const double *v)
LACKS(GetRealOutputDerivatives, const uint32_t *r, size_t n, const int *o, double *v)
LACKS(GetStatus, int kind, int *v)
LACKS(GetIntegerStatus, int kind, int *v)
LACKS(GetStringStatus, int kind, const char **v)

EXPORT int FMI(GetRealStatus)(Instance *i, int kind, double *value)
{
    /* the time of the last step that was taken is the only one of this type */
    *value = i->run.time;
    return OK;
}

EXPORT int FMI(GetBooleanStatus)(Instance *i, int kind, int *value)
{
    /* whether the model wants to end */
    *value = 0;
    return OK;
}
